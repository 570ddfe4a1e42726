//! The way to a syslog server, by UDP or TCP.

use std::fmt;
use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

use embassy_time::Instant;
use embedded_io_async::{Read, Write};
use mobgate::hal::{OpenError, OpenErrorKind, SyslogHost, SyslogLink, TcpConnect as _};
use mobgate::settings::{Syslog, Transport};
use rustix::io::Errno;
use rustix::system::uname;

use crate::calendar::date;
use crate::descriptor::Descriptor;
use crate::tcp::{Connector, TcpStream, addresses_of, refusal};

const LOST: OpenError = OpenError::new(OpenErrorKind::Failed, "the server has closed the connection");

/// Reaches syslog servers from this machine.
pub struct SyslogSockets;

impl SyslogHost for SyslogSockets {
    type Link<'a> = Link;

    async fn open(&mut self, Syslog { transport, server }: &Syslog) -> Result<Link, OpenError> {
        if *transport == Transport::Tcp {
            return Connector.connect(server).await.map(|stream| Link(Socket::Tcp(stream)));
        }
        let addresses = addresses_of(server).await?;
        let open = |to: &SocketAddr| {
            let any = if to.is_ipv4() { Ipv4Addr::UNSPECIFIED.into() } else { Ipv6Addr::UNSPECIFIED.into() };
            let socket = UdpSocket::bind(SocketAddr::new(any, 0))?;
            socket.connect(to)?;
            Descriptor::new(socket)
        };
        let first = addresses.first().ok_or(io::Error::from(Errno::HOSTUNREACH));
        let socket = first.and_then(open).map_err(|error| refusal(&error))?;
        Ok(Link(Socket::Udp(socket)))
    }
}

/// A way to the server.
pub struct Link(Socket);

enum Socket {
    Udp(Descriptor<UdpSocket>),
    Tcp(TcpStream),
}

impl SyslogLink for Link {
    async fn ended(&mut self) -> OpenError {
        let Socket::Tcp(stream) = &mut self.0 else { return std::future::pending().await };
        loop {
            match stream.read(&mut [0; 64]).await {
                Ok(0) => return LOST,
                Ok(_) => {}
                Err(error) => return refusal(&error),
            }
        }
    }

    async fn send(&mut self, bytes: &[u8]) -> Result<(), OpenError> {
        let sent = match &mut self.0 {
            Socket::Udp(socket) => socket.write_with(|socket| socket.send(bytes)).await.map(drop),
            Socket::Tcp(stream) => stream.write_all(bytes).await,
        };
        sent.map_err(|error| refusal(&error))
    }

    fn write_host_name(&self, out: &mut dyn fmt::Write) -> fmt::Result {
        let name = uname();
        let visible = name.nodename().to_bytes().iter().filter(|byte| byte.is_ascii_graphic());
        visible.take(255).try_for_each(|byte| out.write_char(char::from(*byte)))
    }

    fn process(&self) -> Option<u32> {
        Some(std::process::id())
    }

    fn write_date(&self, at: Instant, out: &mut dyn fmt::Write) -> Option<fmt::Result> {
        Some(write!(out, "{:.6}", date(at)))
    }
}
