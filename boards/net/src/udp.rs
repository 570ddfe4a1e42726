//! UDP sockets on embassy-net.

use core::net::SocketAddr;

use embassy_net::udp::{PacketMetadata, SendError, UdpSocket};
use mobgate::hal::{self, OpenError, OpenErrorKind, SocketLost, UdpHost};
use mobgate::settings::TcpListen;

use crate::pool::{Lease, Sockets};
use crate::tcp::{address, endpoint};

/// Most received datagrams that a socket queues, if its buffer has room.
const RECEIVED_MAX: usize = 4;
/// Responses queued for sending; the next `send` waits.
const TO_SEND_MAX: usize = 2;

/// Opens a UDP socket; every port has its own.
pub struct Datagrams {
    sockets: &'static Sockets,
    received: [PacketMetadata; RECEIVED_MAX],
    to_send: [PacketMetadata; TO_SEND_MAX],
}

impl Datagrams {
    /// Takes its socket from `sockets`.
    pub const fn new(sockets: &'static Sockets) -> Self {
        let none = PacketMetadata::EMPTY;
        Self { sockets, received: [none; RECEIVED_MAX], to_send: [none; TO_SEND_MAX] }
    }
}

impl UdpHost for Datagrams {
    type Socket<'a> = Datagram<'a>;

    async fn bind(&mut self, listen: &TcpListen) -> Result<Datagram<'_>, OpenError> {
        let at = endpoint(self.sockets, listen)?;
        let mut lease = Lease::take(self.sockets)?;
        let (receive, transmit) = lease.halves();
        let stack = self.sockets.stack;
        let mut socket = UdpSocket::new(stack, &mut self.received, receive, &mut self.to_send, transmit);
        socket.bind(at).map_err(|_| OpenError::new(OpenErrorKind::Failed, ""))?;
        Ok(Datagram { socket, _lease: lease })
    }
}

/// An open socket. Fields drop in order, so the buffer is returned after the socket is gone.
pub struct Datagram<'a> {
    socket: UdpSocket<'a>,
    _lease: Lease,
}

impl hal::UdpSocket for Datagram<'_> {
    async fn receive(&mut self, into: &mut [u8]) -> Result<(usize, SocketAddr), SocketLost> {
        let received = self.socket.recv_from_with(|datagram, from| {
            let length = datagram.len().min(into.len());
            into[..length].copy_from_slice(&datagram[..length]);
            (length, address(from.endpoint))
        });
        Ok(received.await)
    }

    async fn send(&mut self, datagram: &[u8], to: SocketAddr) -> Result<(), SocketLost> {
        let SocketAddr::V4(to) = to else { return Ok(()) };
        match self.socket.send_to(datagram, (*to.ip(), to.port())).await {
            // No route, or larger than any response: that concerns one peer, not the socket.
            Ok(()) | Err(SendError::NoRoute | SendError::PacketTooLarge) => Ok(()),
            Err(SendError::SocketNotBound) => Err(SocketLost),
        }
    }
}
