//! What a publisher keeps while its connections come and go.

use embassy_time::Instant;
use heapless::{Deque, Vec};

use super::answer::{Answer, Command};
use super::mark::Mark;
use crate::mqtt::{Accepted, Packet};
use crate::settings::POINTS_MAX;

/// Messages that may wait for their acknowledgement.
pub(super) const OPEN_MAX: usize = if cfg!(feature = "small") { 2 } else { 8 };
/// Commands in progress, with answers that are still to be sent.
pub(super) const COMMANDS_MAX: usize = 8;
/// The id of the subscription; those of messages are lower.
pub(super) const SUBSCRIPTION: u16 = u16::MAX;

/// A message that the broker has not acknowledged.
pub(super) struct Open {
    pub(super) id: u16,
    pub(super) packet: Packet,
}

pub(super) struct Session {
    /// In the order in which they were sent first.
    pub(super) open: Vec<Open, OPEN_MAX>,
    last_id: u16,
    pub(super) marks: [Mark; POINTS_MAX],
    /// The point whose turn it is.
    pub(super) turn: usize,
    /// The last line of the audit trail that was looked at.
    pub(super) alarm: u32,
    /// What of a new connection is still to be said: that the gateway is there,
    pub(super) is_born: bool,
    /// and which value of which point is announced next.
    pub(super) announced: (usize, u16),
    /// The number of the next message, for Sparkplug.
    pub(super) seq: u8,
    pub(super) commands: Vec<Command, COMMANDS_MAX>,
    pub(super) answers: Deque<Answer, COMMANDS_MAX>,
}

impl Session {
    /// Without anything sent; alarms up to number `alarm` are of before.
    pub(super) fn new(alarm: u32) -> Self {
        Self {
            open: Vec::new(),
            last_id: 0,
            marks: [const { Mark::NEW }; POINTS_MAX],
            turn: 0,
            alarm,
            is_born: false,
            announced: (0, 0),
            seq: 0,
            commands: Vec::new(),
            answers: Deque::new(),
        }
    }

    /// Prepares for a new connection: what is open is sent again, as a repetition if the broker has kept the session.
    pub(super) fn connected(&mut self, accepted: &Accepted) {
        self.is_born = false;
        self.announced = (0, 0);
        for first in self.open.iter_mut().filter_map(|open| open.packet.first_mut()) {
            *first = *first & !crate::mqtt::DUP | if accepted.has_session { crate::mqtt::DUP } else { 0 };
        }
    }

    /// An id that no open message has.
    pub(super) fn next_id(&mut self) -> u16 {
        loop {
            self.last_id = if self.last_id + 1 < SUBSCRIPTION { self.last_id + 1 } else { 1 };
            if !self.open.iter().any(|open| open.id == self.last_id) {
                return self.last_id;
            }
        }
    }

    /// Handles an acknowledgement; returns whether a message waited for it.
    pub(super) fn acknowledged(&mut self, id: u16) -> bool {
        let at = self.open.iter().position(|open| open.id == id);
        at.map(|at| self.open.remove(at)).is_some()
    }

    /// Messages to send, and those not acknowledged yet.
    pub(super) fn queued(&self) -> u16 {
        let waiting = self.marks.iter().filter(|mark| mark.waits).count();
        (waiting + self.open.len() + self.answers.len()) as u16
    }

    /// Whether another command has a place.
    pub(super) fn takes_command(&self) -> bool {
        self.commands.len() + self.answers.len() < COMMANDS_MAX
    }

    /// When something is to be done even if nothing happens.
    pub(super) fn due(&self) -> Option<Instant> {
        self.commands.iter().map(|command| command.until).min()
    }
}
