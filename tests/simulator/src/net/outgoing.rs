//! Connections that the gateway makes, and the servers in the network that it makes them to.

use std::future::poll_fn;
use std::net::{IpAddr, SocketAddr};
use std::task::{Poll, Waker};

use embassy_time::Timer;
use mobgate::hal::{OpenError, OpenErrorKind, TcpConnect};
use mobgate::settings::{Host, PortId, ServerAddress};

use super::client_stream::ClientStream;
use super::outside::Listening;
use super::pipe::{Path, Pipe};
use super::{GatewayStream, Network, Socket};

const NO_NAME: OpenError = OpenError::new(OpenErrorKind::NotFound, "the name is not known");

/// A server that accepts the gateway's connections; dropped, it listens no more.
pub struct Server {
    network: Network,
    address: SocketAddr,
}

impl Network {
    /// Starts to listen at `address` for the gateway's connections.
    pub fn serve(&self, address: SocketAddr) -> Server {
        self.0.borrow_mut().outside.servers.insert(address, Listening::default());
        Server { network: self.clone(), address }
    }

    /// One more connector for the gateway.
    pub fn connector(&self) -> SimTcpConnect {
        SimTcpConnect(self.clone())
    }

    /// From now on nothing comes back from `address` to who connects there, not even a refusal; or again it does.
    pub fn set_unreachable(&self, address: SocketAddr, unreachable: bool) {
        let set = &mut self.0.borrow_mut().outside.unreachable;
        if unreachable {
            set.insert(address)
        } else {
            set.remove(&address)
        };
    }

    /// How bytes travel to and from `address` on connections made from now on.
    pub fn set_path(&self, address: SocketAddr, path: Path) {
        self.0.borrow_mut().outside.paths.insert(address, path);
    }

    /// The host called `name` has this address from now on, or is not known.
    pub fn set_name(&self, name: &str, address: Option<IpAddr>) {
        let names = &mut self.0.borrow_mut().outside.names;
        match address {
            Some(address) => names.insert(name.to_owned(), address),
            None => names.remove(name),
        };
    }

    fn look_up(&self, name: &str) -> Option<IpAddr> {
        self.0.borrow().outside.names.get(name).copied()
    }

    /// The board has `sockets` for connections that it makes.
    pub fn set_sockets(&self, sockets: usize) {
        self.0.borrow_mut().outside.sockets = Some(sockets);
    }
}

impl Server {
    /// The next connection.
    pub async fn accept(&self) -> ClientStream {
        poll_fn(|context| {
            let mut state = self.network.0.borrow_mut();
            let Some(listening) = state.outside.servers.get_mut(&self.address) else { return Poll::Pending };
            if let Some(stream) = listening.backlog.pop_front() {
                return Poll::Ready(stream);
            }
            listening.waiting = Some(context.waker().clone());
            Poll::Pending
        })
        .await
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let abandoned = self.network.0.borrow_mut().outside.servers.remove(&self.address);
        // Streams may look at the network when they fall, so it must be free by then.
        for stream in abandoned.into_iter().flat_map(|listening| listening.backlog) {
            stream.reset();
        }
    }
}

/// The gateway's way to outside servers.
pub struct SimTcpConnect(Network);

impl TcpConnect for SimTcpConnect {
    type Stream<'a> = GatewayStream;

    async fn connect(&self, server: &ServerAddress) -> Result<GatewayStream, OpenError> {
        let ip = match &server.host {
            Host::Address(address) => *address,
            Host::Name(name) => self.0.look_up(name).ok_or(NO_NAME)?,
        };
        let server = SocketAddr::new(ip, server.port);
        let socket = Socket::take(&self.0).ok_or(OpenError::new(OpenErrorKind::Exhausted, ""))?;
        let path = self.0.0.borrow().outside.paths.get(&server).copied().unwrap_or_default();
        // SYN there, and its acknowledgement back.
        Timer::after(path.latency * 2).await;
        if self.0.0.borrow().outside.unreachable.contains(&server) {
            std::future::pending::<()>().await;
        }
        let mut state = self.0.0.borrow_mut();
        let (up, down) = (Pipe::new(path, state.random.fork()), Pipe::new(path, state.random.fork()));
        let listening = state.outside.servers.get_mut(&server);
        let listening = listening.ok_or(OpenError::new(OpenErrorKind::Refused, ""))?;
        listening.backlog.push_back(ClientStream { incoming: up.clone(), outgoing: down.clone() });
        let waiting = listening.waiting.take();
        state.counters.made += 1;
        drop(state);
        waiting.into_iter().for_each(Waker::wake);
        let (incoming, outgoing) = (down, up);
        Ok(GatewayStream { incoming, outgoing, ended: false, counted_in: None, _socket: Some(socket) })
    }

    async fn handed_over(&self, port: PortId) -> (GatewayStream, SocketAddr) {
        self.0.handover(port).wait().await
    }
}
