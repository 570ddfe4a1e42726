//! Clients that wait for a listening socket.
//!
//! The stack looks at each of its sockets whenever it is polled, so of those that could accept only a few listen. A SYN that finds
//! none of them free waits here until others listen, or a connection of its port has ended; the stack would answer it with a reset.

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
/// A SYN waits this long, unless its client sends it again meanwhile: then the client is still there.
const WAITS_MAX: Duration = Duration::from_secs(3);

/// A time in ticks. It wraps after an hour: once in a while a free socket may seem to have been given a SYN.
type Moment = u32;

fn now() -> Moment {
    Instant::now().as_ticks() as Moment
}

/// Whether this long has passed since `then`.
fn has_passed(time: Duration, then: Moment) -> bool {
    now().wrapping_sub(then) >= time.as_ticks() as Moment
}

/// The frame of a SYN.
type Frame = Vec<u8, SYN_BYTES_MAX, u8>;

/// A SYN that waits since this time.
struct Waiting {
    frame: Frame,
    since: Moment,
}

/// What a socket of the pool does for a TCP port.
enum Host {
    None,
    /// It waits until it may listen on a port.
    Waiting(u16, Option<Waker>),
    /// It listens on a port, and was given a SYN at this time.
    Listening(u16, Option<Moment>),
    /// It has accepted a connection at a port.
    Connected(u16),
}

/// Listening sockets, sockets about to listen, and the SYNs that wait for them.
pub struct Backlog {
    hosts: RefCell<[Host; SOCKETS_MAX]>,
    waiting: RefCell<Vec<Waiting, WAITING_MAX>>,
}

impl Backlog {
    /// No socket listens.
    pub const fn new() -> Self {
        let hosts = RefCell::new([const { Host::None }; SOCKETS_MAX]);
        Self { hosts, waiting: RefCell::new(Vec::new()) }
    }

    /// Waits until the socket of this number may listen on TCP port `port`.
    pub(crate) async fn turn(&self, port: u16, number: usize) -> Turn<'_> {
        let turn = Turn { backlog: self, port, number, has_accepted: false };
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
        let (mut waiting, since) = (self.waiting.borrow_mut(), now());
        // A client that has sent it again waits once. Without room, the client sends it again.
        match waiting.iter_mut().find(|other| Syn::of(&other.frame) == Some(syn)) {
            Some(same) => same.since = since,
            None => {
                let _ = Frame::from_slice(frame).map(|frame| waiting.push(Waiting { frame, since }));
            }
        }
        false
    }

    /// Whether a waiting SYN is given to a socket now: the last one. If not, the task of `context` looks again later.
    pub(crate) fn has_next(&self, context: &Context<'_>) -> bool {
        let mut waiting = self.waiting.borrow_mut();
        waiting.retain(|waiting| !has_passed(WAITS_MAX, waiting.since));
        let next =
            waiting.iter().position(|waiting| Syn::of(&waiting.frame).is_some_and(|syn| self.gives(syn)));
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
        self.waiting.borrow_mut().pop().map(|waiting| waiting.frame).unwrap_or_default()
    }

    /// The socket of this number is none any more.
    pub(crate) fn leaves(&self, number: usize) {
        self.hosts.borrow_mut()[number] = Host::None;
    }

    /// Whether the stack gets a SYN: a free socket is given it, or there is none for the port, and the stack refuses it.
    fn gives(&self, syn: Syn) -> bool {
        let mut is_served = false;
        for host in &mut *self.hosts.borrow_mut() {
            match host {
                Host::Listening(port, given) if *port == syn.to.port() => {
                    if given.is_none_or(|at| has_passed(TAKEN_WITHIN, at)) {
                        *given = Some(now());
                        return true;
                    }
                    is_served = true;
                }
                Host::Waiting(port, _) | Host::Connected(port) if *port == syn.to.port() => is_served = true,
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
    has_accepted: bool,
}

impl Turn<'_> {
    /// The socket has a connection now.
    pub(crate) fn accepted(mut self) {
        self.has_accepted = true;
    }
}

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        let mut hosts = self.backlog.hosts.borrow_mut();
        // Which socket takes a SYN is up to the stack: this one may have taken that of another.
        let mut is_other = matches!(hosts[self.number], Host::Listening(_, None));
        hosts[self.number] = if self.has_accepted { Host::Connected(self.port) } else { Host::None };
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
