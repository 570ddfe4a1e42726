//! UDP sockets, the gateway's and its clients'.

use std::net::{IpAddr, SocketAddr};

use embassy_time::{Duration, with_timeout};
use mobgate::hal::{OpenError, OpenErrorKind, SocketLost, UdpHost, UdpSocket};
use mobgate::settings::TcpListen;

use super::Network;
use super::mailbox::{Datagram, Mailbox, Weather};

impl Network {
    /// One more host of UDP sockets for the gateway.
    pub fn udp_host(&self) -> SimUdpHost {
        SimUdpHost(self.clone())
    }

    /// How datagrams travel from now on.
    pub fn set_weather(&self, weather: Weather) {
        self.0.borrow_mut().weather = weather;
    }

    /// A client on the machine `from` that sends to the gateway's UDP `port`.
    pub fn udp_client(&self, from: IpAddr, port: u16) -> UdpClient {
        let mut state = self.0.borrow_mut();
        let own = state.next_client_port;
        state.next_client_port = own.checked_add(1).unwrap_or(49_152);
        drop(state);
        let (network, mailbox) = (self.clone(), Mailbox::default());
        UdpClient { network, mailbox, address: SocketAddr::new(from, own), port }
    }

    fn post(&self, to: &Mailbox, from: SocketAddr, back: &Mailbox, bytes: &[u8]) {
        let mut state = self.0.borrow_mut();
        let weather = state.weather;
        to.post(&mut state.random, weather, from, back, bytes);
    }
}

/// A client's socket.
pub struct UdpClient {
    network: Network,
    mailbox: Mailbox,
    address: SocketAddr,
    port: u16,
}

impl UdpClient {
    /// Sends a datagram to the gateway; it is lost when nobody listens.
    pub fn send(&self, bytes: &[u8]) {
        let listening = self.network.0.borrow().udp.get(&self.port).cloned();
        if let Some(to) = listening {
            self.network.post(&to, self.address, &self.mailbox, bytes);
        }
    }

    /// The next datagram, if one comes within `patience`.
    pub async fn receive(&self, patience: Duration) -> Option<Vec<u8>> {
        with_timeout(patience, self.mailbox.next()).await.ok().map(|datagram| datagram.bytes)
    }
}

/// The gateway's UDP sockets.
pub struct SimUdpHost(Network);

impl UdpHost for SimUdpHost {
    type Socket<'a> = SimUdpSocket;

    async fn bind(&mut self, listen: &TcpListen) -> Result<SimUdpSocket, OpenError> {
        let mut state = self.0.0.borrow_mut();
        if state.udp.contains_key(&listen.port) {
            return Err(OpenError::new(OpenErrorKind::InUse, ""));
        }
        let mailbox = Mailbox::default();
        state.udp.insert(listen.port, mailbox.clone());
        Ok(SimUdpSocket { network: self.0.clone(), mailbox, port: listen.port, peers: Vec::new() })
    }
}

/// An open socket of the gateway.
pub struct SimUdpSocket {
    network: Network,
    mailbox: Mailbox,
    port: u16,
    peers: Vec<(SocketAddr, Mailbox)>,
}

impl UdpSocket for SimUdpSocket {
    async fn receive(&mut self, into: &mut [u8]) -> Result<(usize, SocketAddr), SocketLost> {
        let Datagram { from, back, bytes, .. } = self.mailbox.next().await;
        self.peers.retain(|(peer, _)| *peer != from);
        self.peers.push((from, back));
        let length = bytes.len().min(into.len());
        into[..length].copy_from_slice(&bytes[..length]);
        Ok((length, from))
    }

    async fn send(&mut self, datagram: &[u8], to: SocketAddr) -> Result<(), SocketLost> {
        let (_, mailbox) =
            self.peers.iter().find(|(peer, _)| *peer == to).expect("a peer that has sent something");
        self.network.post(mailbox, to, &self.mailbox, datagram);
        Ok(())
    }
}

impl Drop for SimUdpSocket {
    fn drop(&mut self) {
        self.network.0.borrow_mut().udp.remove(&self.port);
    }
}
