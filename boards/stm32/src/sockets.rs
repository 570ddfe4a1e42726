//! The sockets of the board's network, for the tasks that have some.

use embassy_net::Stack;
use mobgate_net::Sockets;

/// The board's network.
#[derive(Clone, Copy)]
pub struct Network(pub(crate) &'static Sockets);

impl Network {
    pub(crate) fn stack(&self) -> Stack<'static> {
        self.0.stack()
    }
}
