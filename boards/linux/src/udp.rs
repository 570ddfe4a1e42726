//! UDP sockets.

use std::io;
use std::net::{SocketAddr, UdpSocket as SystemSocket};

use mobgate::hal::{OpenError, SocketLost, UdpHost, UdpSocket};
use mobgate::settings::TcpListen;
use rustix::io::Errno;
use socket2::{Protocol, Type};

use crate::bind;
use crate::descriptor::Descriptor;

/// Opens UDP sockets.
#[derive(Debug, Clone, Copy, Default)]
pub struct Datagrams;

impl UdpHost for Datagrams {
    type Socket<'a> = Datagram;

    async fn bind(&mut self, listen: &TcpListen) -> Result<Datagram, OpenError> {
        Ok(Datagram(bind::at(listen, bound)?))
    }
}

fn bound(at: SocketAddr) -> io::Result<SystemSocket> {
    let socket = bind::socket(at, Type::DGRAM, Protocol::UDP)?;
    socket.bind(&at.into())?;
    Ok(socket.into())
}

/// An open socket.
#[derive(Debug)]
pub struct Datagram(Descriptor<SystemSocket>);

impl UdpSocket for Datagram {
    async fn receive(&mut self, into: &mut [u8]) -> Result<(usize, SocketAddr), SocketLost> {
        loop {
            match self.0.read_with(|socket| socket.recv_from(into)).await {
                Ok(received) => return Ok(received),
                Err(error) if is_peers(&error) => {}
                Err(error) => return Err(lost(&error)),
            }
        }
    }

    async fn send(&mut self, datagram: &[u8], to: SocketAddr) -> Result<(), SocketLost> {
        match self.0.write_with(|socket| socket.send_to(datagram, to)).await {
            Ok(_) => Ok(()),
            Err(error) if is_peers(&error) => Ok(()),
            Err(error) => Err(lost(&error)),
        }
    }
}

/// Whether an error concerns one unreachable peer rather than the socket.
fn is_peers(error: &io::Error) -> bool {
    let errno = Errno::from_io_error(error);
    matches!(
        errno,
        Some(
            Errno::CONNREFUSED
                | Errno::HOSTUNREACH
                | Errno::NETUNREACH
                | Errno::PERM
                | Errno::NOBUFS
                | Errno::INVAL
        )
    )
}

fn lost(error: &io::Error) -> SocketLost {
    log::warn!("UDP: {error}");
    SocketLost
}
