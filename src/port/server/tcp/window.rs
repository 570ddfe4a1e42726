//! How many requests of a connection may be open, by what became of those before.
//!
//! A request that is refused costs the processor nearly as much as one that is served, and its client asks the next one at
//! once instead of waiting for a line. So each refusal narrows the window of its connection and each other response widens
//! it. When it is closed the connection has one request at a time, each when its turn has come: [`Turns`] are given to all
//! such connections of the gateway together, one after the other. What a flood gets costs no more than that, however many
//! take part; who is served as often as refused does not notice. A full queue closes the window at once: another request beside
//! the others would be refused too.

use embassy_time::Instant;

use crate::gateway::turns::Turns;

/// By so many requests a response widens the window that a refusal narrows by one: a client that asks some units that are
/// down among others is not slowed.
const WIDENED: u8 = 2;

/// Of one connection.
pub(crate) struct Window {
    width: u8,
    width_max: u8,
    /// When the next request, or the next connection, may be taken.
    pub(crate) turn: Instant,
    /// Whether anything but refusals was answered.
    useful: bool,
}

impl Window {
    /// All of `pipeline`.
    pub(crate) const fn new(pipeline: u8) -> Self {
        Self { width: pipeline, width_max: pipeline, turn: Instant::MIN, useful: false }
    }

    /// From when on a request may be taken beside those that are `open`; [`Instant::MAX`]: when one of them is answered.
    pub(crate) fn opens(&self, open: u8) -> Instant {
        // What is more than the pipeline holds is refused.
        let is_open = self.width == self.width_max || open < self.width.max(1);
        if is_open { self.turn } else { Instant::MAX }
    }

    /// A request was refused, or there was none in what came.
    pub(crate) fn refused(&mut self, turns: &Turns) {
        match self.width.checked_sub(1) {
            Some(width) => self.width = width,
            None => self.crowded(turns),
        }
    }

    /// A request was refused because too many wait where it goes.
    pub(crate) fn crowded(&mut self, turns: &Turns) {
        self.width = 0;
        self.turn = turns.take(Instant::now());
    }

    /// The connection has ended: one that has brought nothing leaves the next one waiting for a turn.
    pub(crate) fn ended(&mut self, turns: &Turns) {
        self.turn = if self.useful { Instant::MIN } else { turns.take(Instant::now()) };
    }

    /// A request was answered.
    pub(crate) fn answered(&mut self) {
        self.width = self.width.saturating_add(WIDENED).min(self.width_max);
        self.turn = Instant::MIN;
        self.useful = true;
    }
}
