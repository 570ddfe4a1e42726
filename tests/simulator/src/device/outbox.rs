//! What a transmitter still has to send: each response whole, one after the other.

use std::collections::VecDeque;

use embassy_time::{Duration, Instant, Timer};

use crate::fault::{Piece, Sent};

/// The responses that wait for one transmitter.
pub(super) struct Outbox {
    waiting: Vec<Outgoing>,
    /// What is left of the response that has begun.
    begun: VecDeque<Piece>,
    /// When the last piece of it was sent.
    sent: Instant,
}

/// A response that begins as soon after `begin` as the transmitter is free.
struct Outgoing {
    begin: Instant,
    /// The pause of a piece counts from the start of the one before.
    pieces: VecDeque<Piece>,
}

impl Outbox {
    pub(super) fn new() -> Self {
        Self { waiting: Vec::new(), begun: VecDeque::new(), sent: Instant::MIN }
    }

    /// Takes a response that is not to begin before `begin`.
    pub(super) fn push(&mut self, begin: Instant, pieces: Vec<Piece>) {
        self.waiting.push(Outgoing { begin, pieces: pieces.into() });
    }

    /// Waits until a piece is due, and takes it out. Dropping the pending future loses nothing.
    pub(super) async fn due(&mut self) -> Sent {
        while self.begun.is_empty() {
            // Of those that begin at once, the first that came.
            let first = self.waiting.iter().enumerate().min_by_key(|(_, response)| response.begin);
            let Some((index, begin)) = first.map(|(index, response)| (index, response.begin)) else {
                return std::future::pending().await;
            };
            Timer::at(begin).await;
            self.begun = self.waiting.remove(index).pieces;
            self.sent = Instant::now();
        }
        let pause = self.begun.front().map_or(Duration::from_ticks(0), |piece| piece.pause);
        Timer::at(self.sent + pause).await;
        self.sent = Instant::now();
        self.begun.pop_front().map_or(Sent::Close, |piece| piece.what)
    }
}
