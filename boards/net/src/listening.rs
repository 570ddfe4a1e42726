//! How many sockets listen: the stack looks at each socket whenever it is polled, so most of those that could, wait.

use core::cell::RefCell;
use core::future::poll_fn;
use core::task::{Poll, Waker};

use heapless::Vec;

/// Sockets that listen on one TCP port. One that receives a SYN listens no longer, and another does at once: so many SYNs are
/// accepted within one poll of the stack.
const BACKLOG: usize = 3;

/// The TCP ports that `N` sockets listen on, and who waits to listen.
pub(crate) struct Listening<const N: usize> {
    ports: RefCell<Vec<u16, N>>,
    waiting: RefCell<Vec<Waker, N>>,
}

impl<const N: usize> Listening<N> {
    /// Nobody listens.
    pub(crate) const fn new() -> Self {
        Self { ports: RefCell::new(Vec::new()), waiting: RefCell::new(Vec::new()) }
    }

    /// Waits until another socket may listen on TCP port `port`.
    pub(crate) async fn turn(&self, port: u16) -> Turn<'_, N> {
        poll_fn(|context| {
            let mut ports = self.ports.borrow_mut();
            let listen = ports.iter().filter(|other| **other == port).count();
            if listen < BACKLOG && ports.push(port).is_ok() {
                return Poll::Ready(Turn { listening: self, port });
            }
            let mut waiting = self.waiting.borrow_mut();
            if !waiting.iter().any(|waker| waker.will_wake(context.waker())) {
                // Fits: no more hosts wait than there are sockets for.
                let _ = waiting.push(context.waker().clone());
            }
            Poll::Pending
        })
        .await
    }
}

/// The right to listen, until it is dropped.
pub(crate) struct Turn<'s, const N: usize> {
    listening: &'s Listening<N>,
    port: u16,
}

impl<const N: usize> Drop for Turn<'_, N> {
    fn drop(&mut self) {
        let mut ports = self.listening.ports.borrow_mut();
        if let Some(at) = ports.iter().position(|port| *port == self.port) {
            ports.swap_remove(at);
        }
        let mut waiting = self.listening.waiting.borrow_mut();
        while let Some(waker) = waiting.pop() {
            waker.wake();
        }
    }
}
