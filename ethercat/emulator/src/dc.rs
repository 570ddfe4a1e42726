//! Distributed clocks (I, Distributed Clocks; II, 0900h to 09FFh): receive times, system time and drift control here; SYNC0 and
//! SYNC1 ([`sync`]), LATCH0 and LATCH1 ([`latch`]).

pub(crate) mod latch;
pub(crate) mod sync;

use crate::Nanos;
use crate::memory::Memory;
use crate::registers::{
    RECEIVE_TIME_UNIT, RECEIVE_TIMES, SYSTEM_TIME, TIME_DELAY, TIME_DIFFERENCE, TIME_OFFSET,
};

/// A chip's clock.
#[derive(Debug, Clone, Default)]
pub(crate) struct Clock {
    /// Clock value at world time 0: no two chips are powered on at the same time.
    pub(crate) start: Nanos,
    /// Rate deviation from world time, in parts per million.
    pub(crate) drift_ppm: i64,
    /// Correction accumulated by the control loop.
    correction: i64,
}

impl Clock {
    /// The local clock at a world time.
    fn local(&self, at: Nanos) -> i64 {
        let drift = at as i64 * self.drift_ppm / 1_000_000;
        ((self.start + at) as i64 + drift).wrapping_add(self.correction)
    }

    pub(crate) fn system(&self, memory: &Memory, at: Nanos) -> u64 {
        self.local(at).wrapping_add(memory.quad_word(TIME_OFFSET) as i64) as u64
    }

    /// System time as the MainDevice reads it: when the frame passed the reference clock.
    pub(crate) fn show(&self, memory: &mut Memory, at: Nanos) {
        let delay = u64::from(memory.double_word(TIME_DELAY));
        let time = self.system(memory, at).wrapping_sub(delay);
        memory.put(SYSTEM_TIME, &time.to_le_bytes());
    }

    /// System time as the processor reads it.
    pub(crate) fn show_processor(&self, memory: &mut Memory, at: Nanos) {
        let time = self.system(memory, at);
        memory.put(SYSTEM_TIME, &time.to_le_bytes());
    }

    /// Latches a frame's receive time at each port.
    pub(crate) fn latch(&self, memory: &mut Memory, ports: [Option<Nanos>; 4]) {
        for (port, at) in (0..).zip(ports) {
            let time = at.map_or(0, |at| self.local(at) as u64);
            memory.put(RECEIVE_TIMES + 4 * port, &(time as u32).to_le_bytes());
        }
        let unit = ports[0].map_or(0, |at| self.local(at) as u64);
        memory.put(RECEIVE_TIME_UNIT, &unit.to_le_bytes());
    }

    /// Compares the low half of the clock with the reference's time, and corrects half of the difference.
    pub(crate) fn compare(&mut self, memory: &mut Memory, reference: u32, at: Nanos) {
        let delay = memory.double_word(TIME_DELAY);
        let own = (self.system(memory, at) as u32).wrapping_sub(delay);
        let ahead = own.wrapping_sub(reference) as i32;
        self.correction = self.correction.wrapping_sub(i64::from(ahead) / 2);
        let sign = if ahead < 0 { 1 << 31 } else { 0 };
        memory.put(TIME_DIFFERENCE, &(ahead.unsigned_abs() | sign).to_le_bytes());
    }
}
