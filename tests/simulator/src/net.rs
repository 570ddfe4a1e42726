//! TCP within the simulation: listeners, connections, and the ways in which a network is awkward.
//!
//! A client [`connect`](Network::connect)s with a [`Path`] that says how bytes travel in each direction; the gateway's side comes from
//! [`SimTcpHost`]. A connection is two pipes with a bounded window, so a peer that never reads makes the other's write wait.

use std::cell::RefCell;
use std::collections::{HashMap, VecDeque};
use std::future::poll_fn;
use std::net::{IpAddr, SocketAddr};
use std::rc::Rc;
use std::task::{Poll, Waker};

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embedded_io_async::{ErrorKind, ErrorType, Read, Write};
use mobgate::hal::{OpenError, OpenErrorKind, TcpHost, TcpStream};
use mobgate::settings::{PortId, TcpListen};

use crate::random::Random;

mod client_stream;
mod mailbox;
mod outgoing;
mod outside;
mod pipe;
#[cfg(test)]
mod tests;
mod udp;

pub use client_stream::ClientStream;
use mailbox::Mailbox;
pub use mailbox::Weather;
pub use outgoing::{Server, SimTcpConnect};
use outside::Outside;
pub use pipe::Path;
pub(crate) use pipe::Pipe;
pub use udp::{SimUdpHost, SimUdpSocket, UdpClient};

/// Connections that wait for an `accept`; one more is refused.
const BACKLOG_MAX: usize = 128;

/// The network. Clones are the same network.
#[derive(Clone)]
pub struct Network(Rc<RefCell<State>>);

struct State {
    listeners: HashMap<u16, Listener>,
    refused: HashMap<u16, OpenErrorKind>,
    outside: Outside,
    /// What the gateway hands over from the tasks that accept to its client ports.
    handover: HashMap<PortId, Rc<Handover>>,
    udp: HashMap<u16, Mailbox>,
    weather: Weather,
    random: Random,
    next_client_port: u16,
    counters: Counters,
}

type Handover = Signal<NoopRawMutex, (GatewayStream, SocketAddr)>;

#[derive(Default)]
struct Listener {
    hosts: usize,
    backlog: VecDeque<(GatewayStream, SocketAddr)>,
    waiting: Vec<Waker>,
}

/// What a network has counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Connections accepted by the gateway.
    pub accepted: u64,
    /// Connections that the gateway closed in an orderly way.
    pub closed: u64,
    /// Connections that the gateway let fall: the client sees a reset.
    pub dropped: u64,
    /// Connections made by the gateway.
    pub made: u64,
    /// Sockets in use for such connections, and for attempts, now and the most there were at a time.
    pub sockets: u64,
    /// See `sockets`.
    pub sockets_most: u64,
}

impl Network {
    /// A network without listeners; `seed` cuts writes into pieces where a [`Path`] says so.
    pub fn new(seed: u64) -> Self {
        Self(Rc::new(RefCell::new(State {
            listeners: HashMap::new(),
            refused: HashMap::new(),
            outside: Outside::default(),
            handover: HashMap::new(),
            udp: HashMap::new(),
            weather: Weather::default(),
            random: Random::new(seed),
            next_client_port: 49_152,
            counters: Counters::default(),
        })))
    }

    /// One more host for the gateway: it accepts one connection at a time.
    pub fn host(&self) -> SimTcpHost {
        SimTcpHost { network: self.clone(), listening: None }
    }

    /// Makes listening at `port` fail from now on, or work again.
    pub fn refuse_listeners(&self, port: u16, error: Option<OpenErrorKind>) {
        let mut state = self.0.borrow_mut();
        match error {
            Some(kind) => state.refused.insert(port, kind),
            None => state.refused.remove(&port),
        };
    }

    /// Connects to the gateway's `port` as the machine `from`, over a path without awkwardness.
    pub fn connect(&self, from: IpAddr, port: u16) -> Result<ClientStream, ErrorKind> {
        self.connect_over(Path::default(), from, port)
    }

    /// Connects over `path`. An error when nobody listens, or too many wait to be accepted.
    pub fn connect_over(&self, path: Path, from: IpAddr, port: u16) -> Result<ClientStream, ErrorKind> {
        let mut state = self.0.borrow_mut();
        let client_port = state.next_client_port;
        state.next_client_port = client_port.checked_add(1).unwrap_or(49_152);
        let up = Pipe::new(path, state.random.fork());
        let down = Pipe::new(path, state.random.fork());
        let listener = state.listeners.get_mut(&port).filter(|listener| listener.backlog.len() < BACKLOG_MAX);
        let listener = listener.ok_or(ErrorKind::ConnectionRefused)?;
        let stream = GatewayStream {
            incoming: up.clone(),
            outgoing: down.clone(),
            ended: false,
            counted_in: Some(self.clone()),
            _socket: None,
        };
        listener.backlog.push_back((stream, SocketAddr::new(from, client_port)));
        let waiting = std::mem::take(&mut listener.waiting);
        drop(state);
        waiting.into_iter().for_each(Waker::wake);
        Ok(ClientStream { incoming: down, outgoing: up })
    }

    /// Whether anybody listens at `port`.
    pub fn is_listening(&self, port: u16) -> bool {
        self.0.borrow().listeners.contains_key(&port)
    }

    /// Where connections for the client port `port` wait.
    fn handover(&self, port: PortId) -> Rc<Handover> {
        self.0.borrow_mut().handover.entry(port).or_insert_with(|| Rc::new(Signal::new())).clone()
    }

    /// What has been counted so far.
    pub fn counters(&self) -> Counters {
        self.0.borrow().counters
    }
}

/// The gateway's view of the network. It listens until it is dropped or accepts elsewhere.
pub struct SimTcpHost {
    network: Network,
    listening: Option<u16>,
}

impl SimTcpHost {
    /// The last host to leave a port resets who waits there.
    fn leave(&mut self) {
        let Some(port) = self.listening.take() else { return };
        let mut state = self.network.0.borrow_mut();
        let Some(listener) = state.listeners.get_mut(&port) else { return };
        listener.hosts -= 1;
        let abandoned = if listener.hosts == 0 { state.listeners.remove(&port) } else { None };
        // Streams count themselves when they fall, so the state must be free by then.
        drop(state);
        drop(abandoned);
    }
}

impl Drop for SimTcpHost {
    fn drop(&mut self) {
        self.leave();
    }
}

impl TcpHost for SimTcpHost {
    type Stream<'a> = GatewayStream;

    fn listen(&mut self, listen: &TcpListen) -> Result<(), OpenError> {
        let port = listen.port;
        if let Some(&kind) = self.network.0.borrow().refused.get(&port) {
            return Err(OpenError::new(kind, ""));
        }
        if self.listening != Some(port) {
            self.leave();
            self.network.0.borrow_mut().listeners.entry(port).or_default().hosts += 1;
            self.listening = Some(port);
        }
        Ok(())
    }

    async fn accept(&mut self, listen: &TcpListen) -> Result<(GatewayStream, SocketAddr), OpenError> {
        self.listen(listen)?;
        let port = listen.port;
        poll_fn(|context| {
            let mut state = self.network.0.borrow_mut();
            let Some(listener) = state.listeners.get_mut(&port) else { return Poll::Pending };
            let Some(accepted) = listener.backlog.pop_front() else {
                if !listener.waiting.iter().any(|waker| waker.will_wake(context.waker())) {
                    listener.waiting.push(context.waker().clone());
                }
                return Poll::Pending;
            };
            state.counters.accepted += 1;
            Poll::Ready(Ok(accepted))
        })
        .await
    }
}

/// The gateway's end of a connection. Dropped without [`close`](TcpStream::close) it resets the connection.
pub struct GatewayStream {
    incoming: Pipe,
    outgoing: Pipe,
    ended: bool,
    /// Where it is counted how an accepted connection ends; those that the gateway made are not.
    counted_in: Option<Network>,
    /// In use by a connection that the gateway made.
    _socket: Option<Socket>,
}

impl GatewayStream {
    fn count(&self, end: impl FnOnce(&mut Counters)) {
        if let Some(network) = &self.counted_in {
            end(&mut network.0.borrow_mut().counters);
        }
    }
}

impl TcpStream for GatewayStream {
    /// Only who has connected can be handed over.
    fn hand_over(self, port: PortId, peer: SocketAddr) {
        if let Some(network) = self.counted_in.clone() {
            network.handover(port).signal((self, peer));
        }
    }

    /// What has been written still arrives, then the FIN.
    async fn close(mut self) {
        self.ended = true;
        self.count(|counters| counters.closed += 1);
        self.outgoing.finish();
        self.incoming.abandon();
    }
}

impl Drop for GatewayStream {
    fn drop(&mut self) {
        if !self.ended {
            self.count(|counters| counters.dropped += 1);
            self.outgoing.reset();
            self.incoming.reset();
        }
    }
}

impl ErrorType for GatewayStream {
    type Error = ErrorKind;
}

impl Read for GatewayStream {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, ErrorKind> {
        self.incoming.read(into).await
    }
}

impl Write for GatewayStream {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, ErrorKind> {
        self.outgoing.write(bytes).await
    }

    /// Waits for the peer's acknowledgement of everything, as embassy-net does.
    async fn flush(&mut self) -> Result<(), ErrorKind> {
        self.outgoing.acknowledged().await
    }
}

/// One of the board's sockets, in use until it is dropped.
struct Socket(Network);

impl Socket {
    fn take(network: &Network) -> Option<Self> {
        let mut state = network.0.borrow_mut();
        if let Some(left) = &mut state.outside.sockets {
            *left = left.checked_sub(1)?;
        }
        let counters = &mut state.counters;
        counters.sockets += 1;
        counters.sockets_most = counters.sockets_most.max(counters.sockets);
        drop(state);
        Some(Self(network.clone()))
    }
}

impl Drop for Socket {
    fn drop(&mut self) {
        let mut state = self.0.0.borrow_mut();
        if let Some(left) = &mut state.outside.sockets {
            *left += 1;
        }
        state.counters.sockets -= 1;
    }
}
