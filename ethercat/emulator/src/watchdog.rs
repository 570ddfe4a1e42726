//! The watchdogs of process data and of the processor's side (I, Watchdogs; II, 0400h to 0443h).

use crate::Nanos;
use crate::memory::Memory;
use crate::registers::{WATCHDOG_COUNTERS, WATCHDOG_DATA, WATCHDOG_DIVIDER, WATCHDOG_PDI};

/// Period of the clock that the divider divides.
const BASE_NANOS: u64 = 40;

/// One watchdog; it starts at its first trigger.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Watchdog {
    /// The register with its time, in ticks of the divider; 0 disables it.
    time: u16,
    counter: u16,
    expires: Option<Nanos>,
    expired: bool,
}

impl Watchdog {
    pub(crate) fn of_process_data() -> Self {
        Self { time: WATCHDOG_DATA, counter: WATCHDOG_COUNTERS, expires: None, expired: false }
    }

    pub(crate) fn of_pdi() -> Self {
        Self { time: WATCHDOG_PDI, counter: WATCHDOG_COUNTERS + 1, expires: None, expired: false }
    }

    pub(crate) fn trigger(&mut self, memory: &Memory, at: Nanos) {
        let tick = (u64::from(memory.word(WATCHDOG_DIVIDER)) + 2) * BASE_NANOS;
        let time = u64::from(memory.word(self.time)) * tick;
        self.expired = false;
        self.expires = (time > 0).then_some(at + time);
    }

    /// Expires if due; returns whether it just did.
    pub(crate) fn advance(&mut self, memory: &mut Memory, at: Nanos) -> bool {
        if memory.word(self.time) == 0 {
            self.expires = None;
            self.expired = false;
        }
        if self.expires.is_none_or(|expires| at < expires) {
            return false;
        }
        self.expires = None;
        self.expired = true;
        memory.set_byte(self.counter, memory.byte(self.counter).saturating_add(1));
        true
    }

    pub(crate) fn is_fine(&self) -> bool {
        !self.expired
    }

    pub(crate) fn next(&self) -> Option<Nanos> {
        self.expires
    }
}
