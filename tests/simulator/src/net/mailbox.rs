//! Datagrams under way, and what a network does to them: it loses, doubles and delays, so that they overtake each other.

use std::cell::RefCell;
use std::future::poll_fn;
use std::net::SocketAddr;
use std::rc::Rc;
use std::task::{Poll, Waker};

use embassy_time::{Duration, Instant};
use embassy_time_driver::schedule_wake;

use crate::random::Random;

/// How datagrams travel, in both directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weather {
    /// Probability that a datagram is lost.
    pub loss: f64,
    /// Probability that it comes twice.
    pub doubling: f64,
    /// It takes a time between the two.
    pub latency: (Duration, Duration),
}

impl Default for Weather {
    /// Everything arrives once, at once.
    fn default() -> Self {
        let zero = Duration::from_ticks(0);
        Self { loss: 0.0, doubling: 0.0, latency: (zero, zero) }
    }
}

/// Datagrams under way to one receiver, and those that have arrived.
#[derive(Clone, Default)]
pub(super) struct Mailbox(Rc<RefCell<Mail>>);

#[derive(Default)]
struct Mail {
    datagrams: Vec<Datagram>,
    waiting: Option<Waker>,
}

#[derive(Clone)]
pub(super) struct Datagram {
    arrival: Instant,
    pub(super) from: SocketAddr,
    /// Where a response goes.
    pub(super) back: Mailbox,
    pub(super) bytes: Vec<u8>,
}

impl Mailbox {
    pub(super) fn post(
        &self,
        random: &mut Random,
        weather: Weather,
        from: SocketAddr,
        back: &Self,
        bytes: &[u8],
    ) {
        if random.chance(weather.loss) {
            return;
        }
        let copies = 1 + usize::from(random.chance(weather.doubling));
        let mut mail = self.0.borrow_mut();
        for _ in 0..copies {
            let (least, most) = weather.latency;
            let latency = Duration::from_ticks(random.within(least.as_ticks()..=most.as_ticks()));
            let arrival = Instant::now() + latency;
            mail.datagrams.push(Datagram { arrival, from, back: back.clone(), bytes: bytes.to_vec() });
        }
        mail.waiting.take().into_iter().for_each(Waker::wake);
    }

    pub(super) async fn next(&self) -> Datagram {
        poll_fn(|context| {
            let mut mail = self.0.borrow_mut();
            let first = mail.datagrams.iter().enumerate().min_by_key(|(_, datagram)| datagram.arrival);
            match first.map(|(index, datagram)| (index, datagram.arrival)) {
                Some((index, arrival)) if arrival <= Instant::now() => {
                    return Poll::Ready(mail.datagrams.remove(index));
                }
                Some((_, arrival)) => schedule_wake(arrival.as_ticks(), context.waker()),
                None => {}
            }
            mail.waiting = Some(context.waker().clone());
            Poll::Pending
        })
        .await
    }
}
