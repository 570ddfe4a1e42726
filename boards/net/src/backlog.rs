//! Clients that wait for a listening socket.
//!
//! The stack looks at each of its sockets whenever it is polled, so of those that could accept only a few listen. A SYN that finds
//! none of them free waits here until the tasks of the last ones have run and others listen; the stack would answer it with a reset.

use core::cell::RefCell;
use core::future::poll_fn;
use core::task::{Context, Poll, Waker};

use embassy_time::{Duration, Instant};
use heapless::Vec;

use crate::SOCKETS_MAX;
use crate::syn::{SYN_BYTES_MAX, Syn};

/// Sockets that listen on a TCP port at a time: one, and another until the task of the first one has run.
const LISTENING_MAX: usize = 2;
/// SYNs that wait. Those of further clients are lost, and sent again after a second.
const WAITING_MAX: usize = 8;
/// A socket that still listens this long after it was given a SYN has not taken it: the stack had a reason to ignore the frame.
const TAKEN_WITHIN: Duration = Duration::from_millis(100);

/// A time in ticks. It wraps after an hour: once in a while a free socket may seem to have been given a SYN.
type Moment = u32;
type Frame = Vec<u8, SYN_BYTES_MAX, u8>;

/// What a socket of the pool is to accept.
enum Host {
    None,
    /// It waits until it may listen on a port.
    Waiting(u16, Option<Waker>),
    /// It listens on a port, and was given a SYN at this time.
    Listening(u16, Option<Moment>),
}

/// Listening sockets, sockets about to listen, and the SYNs that wait for them.
pub struct Backlog {
    hosts: RefCell<[Host; SOCKETS_MAX]>,
    waiting: RefCell<Vec<Frame, WAITING_MAX>>,
}

impl Backlog {
    /// No socket listens.
    pub const fn new() -> Self {
        let hosts = RefCell::new([const { Host::None }; SOCKETS_MAX]);
        Self { hosts, waiting: RefCell::new(Vec::new()) }
    }

    /// Waits until the socket of this number may listen on TCP port `port`.
    pub(crate) async fn turn(&self, port: u16, number: usize) -> Turn<'_> {
        let turn = Turn { backlog: self, port, number };
        poll_fn(|context| {
            let mut hosts = self.hosts.borrow_mut();
            let is_at = |host: &&Host| matches!(host, Host::Listening(at, _) if *at == port);
            if hosts.iter().filter(is_at).count() < LISTENING_MAX {
                hosts[number] = Host::Listening(port, None);
                return Poll::Ready(());
            }
            hosts[number] = Host::Waiting(port, Some(context.waker().clone()));
            Poll::Pending
        })
        .await;
        turn
    }

    /// Whether no SYN waits.
    pub(crate) fn is_empty(&self) -> bool {
        self.waiting.borrow().is_empty()
    }

    /// Whether the stack is to have this frame now. A SYN for which no socket is free waits, or is lost.
    pub(crate) fn admits(&self, frame: &[u8]) -> bool {
        let Some(syn) = Syn::of(frame) else { return true };
        if self.gives(syn) || frame.len() > SYN_BYTES_MAX {
            return true;
        }
        let mut waiting = self.waiting.borrow_mut();
        // A client that has sent it again waits once. Without room, the client sends it again.
        if !waiting.iter().any(|other| Syn::of(other) == Some(syn)) {
            let _ = Frame::from_slice(frame).map(|frame| waiting.push(frame));
        }
        false
    }

    /// Whether a waiting SYN is given to a socket now: the last one. If not, the task of `context` looks again later.
    pub(crate) fn has_next(&self, context: &Context<'_>) -> bool {
        let mut waiting = self.waiting.borrow_mut();
        let next = waiting.iter().position(|frame| Syn::of(frame).is_some_and(|syn| self.gives(syn)));
        if let Some(next) = next {
            let last = waiting.len() - 1;
            waiting.swap(next, last);
        } else {
            embassy_time_driver::schedule_wake((Instant::now() + TAKEN_WITHIN).as_ticks(), context.waker());
        }
        next.is_some()
    }

    /// Takes out the last waiting SYN, for the stack.
    pub(crate) fn take(&self) -> Frame {
        self.waiting.borrow_mut().pop().unwrap_or_default()
    }

    /// Whether the stack gets a SYN: a free socket is given it, or there is none for the port, and the stack refuses it.
    fn gives(&self, syn: Syn) -> bool {
        let (now, mut is_served) = (Instant::now().as_ticks() as Moment, false);
        for host in &mut *self.hosts.borrow_mut() {
            match host {
                Host::Listening(port, given) if *port == syn.to.port() => {
                    let is_free = |at| now.wrapping_sub(at) >= TAKEN_WITHIN.as_ticks() as Moment;
                    if given.is_none_or(is_free) {
                        *given = Some(now);
                        return true;
                    }
                    is_served = true;
                }
                Host::Waiting(port, _) if *port == syn.to.port() => is_served = true,
                _ => {}
            }
        }
        !is_served
    }
}

/// The right to listen, until it is dropped.
pub(crate) struct Turn<'b> {
    backlog: &'b Backlog,
    port: u16,
    number: usize,
}

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        let mut hosts = self.backlog.hosts.borrow_mut();
        // Which socket takes a SYN is up to the stack: this one may have taken that of another.
        let mut is_other = matches!(hosts[self.number], Host::Listening(_, None));
        hosts[self.number] = Host::None;
        let mut next = None;
        for host in &mut *hosts {
            match host {
                Host::Listening(port, given) if *port == self.port && is_other => {
                    is_other = given.take().is_none()
                }
                Host::Waiting(port, waker) if *port == self.port && next.is_none() => next = waker.take(),
                _ => {}
            }
        }
        if let Some(next) = next {
            next.wake();
        }
    }
}
