//! The way to a syslog server on embassy-net: by a UDP socket of its own, or a TCP connection of the pool.

use core::fmt;
use core::net::Ipv4Addr;

use embassy_futures::join::join;
use embassy_futures::select::select;
use embassy_net::Stack;
use embassy_net::udp::{PacketMetadata, SendError, UdpSocket};
use embedded_io_async::{Read, Write};
use heapless::String;
use mobgate::gateway::Gateway;
use mobgate::gateway::audit::MESSAGE_BYTES_MAX;
use mobgate::hal::{OpenError, OpenErrorKind, SyslogHost, SyslogLink, TcpConnect};
use mobgate::settings::{HOST_NAME_BYTES_MAX, Syslog, Transport};

use crate::address::state;
use crate::connector::{Connector, address_of};
use crate::mdns::own_name;
use crate::pool::Sockets;
use crate::tcp::TcpStream;

const DOWN: OpenError = OpenError::new(OpenErrorKind::NotFound, "the network is down: see show network");
const LOST: OpenError = OpenError::new(OpenErrorKind::Failed, "the server has closed the connection");

/// Reaches syslog servers from a board.
pub(crate) struct SyslogSockets<'g> {
    gateway: &'g Gateway<'g>,
    sockets: &'static Sockets,
    /// Nothing is received.
    received: ([PacketMetadata; 1], [u8; 1]),
    /// One message at a time.
    to_send: ([PacketMetadata; 1], [u8; MESSAGE_BYTES_MAX]),
}

impl<'g> SyslogSockets<'g> {
    /// Takes a TCP socket from `sockets`, and a UDP socket from their stack.
    pub(crate) const fn new(gateway: &'g Gateway<'g>, sockets: &'static Sockets) -> Self {
        let none = PacketMetadata::EMPTY;
        Self { gateway, sockets, received: ([none], [0]), to_send: ([none], [0; MESSAGE_BYTES_MAX]) }
    }
}

impl SyslogHost for SyslogSockets<'_> {
    type Link<'a>
        = Link<'a>
    where
        Self: 'a;

    async fn open(&mut self, Syslog { transport, server }: &Syslog) -> Result<Link<'_>, OpenError> {
        let stack = self.sockets.stack();
        join(stack.wait_link_up(), stack.wait_config_up()).await;
        let own = own_name(state(stack).hardware);
        let name =
            self.gateway.settings(|settings| String::try_from(settings.mdns_name(&own).unwrap_or(&own)));
        // Both are names of hosts.
        let name = name.unwrap_or_default();
        let way = match transport {
            Transport::Tcp => Way::Tcp(Connector::new(self.sockets).connect(server).await?),
            Transport::Udp => {
                let to = (address_of(stack, server).await?, server.port);
                let (received, to_send) = (&mut self.received, &mut self.to_send);
                let mut socket =
                    UdpSocket::new(stack, &mut received.0, &mut received.1, &mut to_send.0, &mut to_send.1);
                socket.bind(0).map_err(|_| OpenError::new(OpenErrorKind::Failed, ""))?;
                Way::Udp { socket, to, stack }
            }
        };
        Ok(Link { way, name })
    }
}

/// A way to the server.
pub(crate) struct Link<'a> {
    way: Way<'a>,
    name: String<HOST_NAME_BYTES_MAX>,
}

enum Way<'a> {
    Udp { socket: UdpSocket<'a>, to: (Ipv4Addr, u16), stack: Stack<'static> },
    Tcp(TcpStream),
}

impl SyslogLink for Link<'_> {
    async fn ended(&mut self) -> OpenError {
        match &mut self.way {
            Way::Udp { stack, .. } => {
                select(stack.wait_link_down(), stack.wait_config_down()).await;
                DOWN
            }
            Way::Tcp(stream) => loop {
                match stream.read(&mut [0; 64]).await {
                    Ok(0) | Err(_) => return LOST,
                    Ok(_) => {}
                }
            },
        }
    }

    async fn send(&mut self, bytes: &[u8]) -> Result<(), OpenError> {
        match &mut self.way {
            Way::Udp { socket, to, .. } => {
                match socket.send_to(bytes, *to).await {
                    Ok(()) => {}
                    Err(SendError::NoRoute) => return Err(DOWN),
                    Err(_) => return Err(OpenError::new(OpenErrorKind::Failed, "")),
                }
                // It waits in the socket while nobody says whose Ethernet address it is.
                socket.flush().await;
                Ok(())
            }
            Way::Tcp(stream) => stream.write_all(bytes).await.map_err(|_| LOST),
        }
    }

    fn write_host_name(&self, out: &mut dyn fmt::Write) -> fmt::Result {
        out.write_str(&self.name)
    }
}
