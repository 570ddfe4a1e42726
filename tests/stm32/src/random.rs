//! The generator of random numbers (RM0090, 24; RM0410, 20; RM0433, 34).

use crate::time::{SECOND, Time};

const CR: u32 = 0;
const SR: u32 = 4;
const DR: u32 = 8;
const RNGEN: u32 = 1 << 2;
const IE: u32 = 1 << 3;
const CED: u32 = 1 << 5;
const DRDY: u32 = 1;
/// Clock and seed errors, as they are now, and as they were: these stay until they are cleared.
const CECS_CEIS: u32 = 1 << 1 | 1 << 5;
const SECS_SEIS: u32 = 1 << 2 | 1 << 6;
const KEPT: u32 = 1 << 5 | 1 << 6;
/// The fastest clock that it works with.
const HZ_MAX: u64 = 48_000_000;
/// Cycles of its clock for a number.
const CYCLES: u64 = 40;

/// The generator.
pub(crate) struct Random {
    control: u32,
    status: u32,
    /// What it is made of here: the next number follows from it.
    state: u32,
    /// When a number is there, and how long one takes.
    ready: Option<Time>,
    period: Time,
    /// The noise fails.
    pub(crate) is_spoilt: bool,
}

impl Random {
    pub(crate) fn new() -> Self {
        Self { control: 0, status: 0, state: 0x2545_f491, ready: None, period: 0, is_spoilt: false }
    }

    /// A noise does not begin anew.
    pub(crate) fn after_reset(&self) -> Self {
        Self { state: self.state, is_spoilt: self.is_spoilt, ..Self::new() }
    }

    pub(crate) fn read(&mut self, offset: u32, now: Time) -> Option<u32> {
        let is_ready = self.ready.is_some_and(|at| at <= now);
        match offset {
            CR => Some(self.control),
            SR => Some(self.status | if is_ready { DRDY } else { 0 }),
            DR if is_ready => {
                self.ready = Some(now + self.period);
                self.state ^= self.state << 13;
                self.state ^= self.state >> 17;
                self.state ^= self.state << 5;
                Some(self.state)
            }
            DR => Some(0),
            _ => None,
        }
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32, now: Time, hz: u64) -> Option<()> {
        match offset {
            CR if value & !(RNGEN | IE | CED) == 0 => {
                let starts = value & RNGEN != 0 && self.control & RNGEN == 0;
                self.control = value;
                if value & RNGEN == 0 {
                    (self.ready, self.status) = (None, self.status & KEPT);
                } else if starts {
                    self.start(now, hz);
                }
                Some(())
            }
            SR => {
                self.status &= value | !KEPT;
                Some(())
            }
            _ => None,
        }
    }

    fn start(&mut self, now: Time, hz: u64) {
        if !(1..=HZ_MAX).contains(&hz) {
            self.status |= CECS_CEIS;
        } else if self.is_spoilt {
            self.status |= SECS_SEIS;
        } else {
            self.period = SECOND / hz * CYCLES;
            self.ready = Some(now + self.period);
        }
    }
}
