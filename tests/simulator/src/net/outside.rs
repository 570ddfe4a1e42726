//! What is outside of the gateway's board: servers, names, and the ways there.

use std::collections::{HashMap, HashSet, VecDeque};
use std::net::{IpAddr, SocketAddr};
use std::task::Waker;

use super::client_stream::ClientStream;
use super::pipe::Path;

/// What the gateway can connect to.
#[derive(Default)]
pub(super) struct Outside {
    pub(super) servers: HashMap<SocketAddr, Listening>,
    pub(super) unreachable: HashSet<SocketAddr>,
    pub(super) paths: HashMap<SocketAddr, Path>,
    pub(super) names: HashMap<String, IpAddr>,
    /// Sockets of the board that are left; none: as many as wanted.
    pub(super) sockets: Option<usize>,
}

#[derive(Default)]
pub(super) struct Listening {
    pub(super) backlog: VecDeque<ClientStream>,
    pub(super) waiting: Option<Waker>,
}
