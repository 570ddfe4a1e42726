//! Answers that are kept for reads whose rule lets them be answered from memory: pure, with time as a value.
//!
//! A response is as old as its request: the device has read the values after that. Where there is no room, the oldest one goes. A
//! write to a unit makes everything void that is known of it, whichever addresses it names: what a register does to others
//! is the device's affair.

use embassy_time::{Duration, Instant};
use heapless::Vec;

use crate::modbus::PDU_BYTES_MAX;
use crate::modbus::pdu::Block;
use crate::port::client::queue::BROADCAST;

/// Answers that one port keeps. The feature `small` saves memory here.
pub const RESPONSES_MAX: usize = if cfg!(feature = "small") { 8 } else { 16 };
/// Bytes of them all: three of the longest, or sixteen of 22 registers; `small`: one, or eight of 15.
pub const RESPONSE_BYTES_MAX: usize = if cfg!(feature = "small") { PDU_BYTES_MAX } else { 3 * PDU_BYTES_MAX };

/// A read of coils, inputs or registers, of a unit: functions 1 to 4. Answers to others are not kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Question {
    /// The unit.
    pub unit: u8,
    /// What it is asked for.
    pub block: Block,
}

impl Question {
    /// The question that `request` asks `unit`, if it is of a kind whose answers are kept.
    pub fn new(unit: u8, request: &[u8]) -> Option<Self> {
        Some(Self { unit, block: Block::of(request)? })
    }
}

/// A response that is kept. Unit and length stand together in what the block leaves of eight bytes.
struct Kept {
    unit: u8,
    length: u8,
    block: Block,
    sent: Instant,
}

impl Kept {
    fn is_for(&self, question: Question) -> bool {
        self.block == question.block && self.unit == question.unit
    }
}

/// The responses that one port keeps.
pub struct Cache {
    /// In the order in which they came.
    kept: Vec<Kept, RESPONSES_MAX>,
    /// Their PDUs, in the same order.
    bytes: Vec<u8, RESPONSE_BYTES_MAX>,
}

impl Cache {
    /// No responses.
    pub const fn new() -> Self {
        Self { kept: Vec::new(), bytes: Vec::new() }
    }

    /// Keeps `response` to what was asked at `sent`.
    pub fn keep(&mut self, question: Question, response: &[u8], sent: Instant) {
        self.remove(|kept| kept.is_for(question));
        while self.kept.is_full() || RESPONSE_BYTES_MAX - self.bytes.len() < response.len() {
            if self.kept.is_empty() {
                // It is longer than a PDU may be.
                return;
            }
            self.remove_at(0);
        }
        let Question { unit, block } = question;
        let kept = Kept { unit, length: response.len() as u8, block, sent };
        // There is room for both now.
        if self.bytes.extend_from_slice(response).is_ok() {
            let _ = self.kept.push(kept);
        }
    }

    /// The response to `question`, unless it is older than `age`.
    pub fn response(&self, question: Question, now: Instant, age: Duration) -> Option<&[u8]> {
        let index = self.kept.iter().position(|kept| kept.is_for(question))?;
        let kept = self.kept.get(index)?;
        if now.saturating_duration_since(kept.sent) > age {
            return None;
        }
        let start = self.start(index);
        self.bytes.get(start..start + usize::from(kept.length))
    }

    /// Something was written to `unit`, or to all units.
    pub fn written(&mut self, unit: u8) {
        self.remove(|kept| unit == BROADCAST || kept.unit == unit);
    }

    /// Forgets what `these` units have answered.
    pub fn forget(&mut self, these: impl Fn(u8) -> bool) {
        self.remove(|kept| these(kept.unit));
    }

    /// Answers that are kept.
    pub fn len(&self) -> usize {
        self.kept.len()
    }

    /// Whether none is.
    pub fn is_empty(&self) -> bool {
        self.kept.is_empty()
    }

    fn remove(&mut self, which: impl Fn(&Kept) -> bool) {
        while let Some(index) = self.kept.iter().position(&which) {
            self.remove_at(index);
        }
    }

    fn remove_at(&mut self, index: usize) {
        let start = self.start(index);
        let end = start + usize::from(self.kept.remove(index).length);
        self.bytes.copy_within(end.., start);
        self.bytes.truncate(self.bytes.len() - (end - start));
    }

    fn start(&self, index: usize) -> usize {
        self.kept.iter().take(index).map(|kept| usize::from(kept.length)).sum()
    }
}

impl Default for Cache {
    fn default() -> Self {
        Self::new()
    }
}
