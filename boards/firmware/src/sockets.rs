//! A handle of the network's sockets for tasks.

use embassy_net::Stack;
use mobgate_net::Sockets;

/// The board's network.
#[derive(Clone, Copy)]
pub struct Network(pub(crate) &'static Sockets);

impl Network {
    /// The network's stack.
    pub fn stack(&self) -> Stack<'static> {
        self.0.stack()
    }
}
