//! Flow control per connection: how many requests may be open, depending on the outcome of earlier ones.
//!
//! A refused request costs the processor nearly as much as a served one, and its client sends the next at once instead of waiting
//! for a line. So each refusal narrows the window of its connection, and each other response widens it. With a closed window a
//! connection has one request at a time, each in its turn: all such connections of the gateway share the [`Turns`]. That bounds the
//! cost of a flood, regardless of the number of connections; clients that are served as often as refused are not affected. A full
//! queue closes the window at once, since further requests would be refused too.

use embassy_time::Instant;

use crate::gateway::turns::Turns;

/// How far a response widens the window; a refusal narrows it by one. So a client that also polls units that are down is not
/// slowed.
const WIDENED: u8 = 2;

/// The window of one connection.
pub(crate) struct Window {
    width: u8,
    width_max: u8,
    /// When the next request, or the next connection, may be accepted.
    pub(crate) turn: Instant,
    /// Whether anything but refusals was returned.
    useful: bool,
}

impl Window {
    /// A fully open window of `pipeline`.
    pub(crate) const fn new(pipeline: u8) -> Self {
        Self { width: pipeline, width_max: pipeline, turn: Instant::MIN, useful: false }
    }

    /// When a request may be accepted in addition to the `open` ones; [`Instant::MAX`]: once one of them has its response.
    pub(crate) fn opens(&self, open: u8) -> Instant {
        // Beyond the pipeline, requests are refused.
        let is_open = self.width == self.width_max || open < self.width.max(1);
        if is_open { self.turn } else { Instant::MAX }
    }

    /// Handles a refused request, or input without one.
    pub(crate) fn refused(&mut self, turns: &Turns) {
        match self.width.checked_sub(1) {
            Some(width) => self.width = width,
            None => self.crowded(turns),
        }
    }

    /// Handles a request refused because its port's queue is full.
    pub(crate) fn crowded(&mut self, turns: &Turns) {
        self.width = 0;
        self.turn = turns.take(Instant::now());
    }

    /// Handles the end of the connection. If it was useless, the next one waits for a turn.
    pub(crate) fn ended(&mut self, turns: &Turns) {
        self.turn = if self.useful { Instant::MIN } else { turns.take(Instant::now()) };
    }

    /// Handles an answered request.
    pub(crate) fn answered(&mut self) {
        self.width = self.width.saturating_add(WIDENED).min(self.width_max);
        self.turn = Instant::MIN;
        self.useful = true;
    }
}
