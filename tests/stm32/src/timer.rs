//! TIM5: a counter of 32 bits with one compare channel (RM0090, 18; the same on the other families).

use crate::bank::{ALL, Bank};
use crate::time::{SECOND, Time};

const DIER: u32 = 0x0c;
const SR: u32 = 0x10;
const EGR: u32 = 0x14;
const CNT: u32 = 0x24;
const PSC: u32 = 0x28;
const CCR1: u32 = 0x34;

pub(crate) struct Timer {
    registers: Bank,
    /// The count when the time was `since`.
    base: u32,
    since: Time,
    /// Clock cycles per count in use, and the clock.
    divider: u64,
    clock_hz: u64,
    running: bool,
    compare_at: Option<Time>,
}

impl Timer {
    pub(crate) fn new() -> Self {
        let mut rows: Vec<_> = (0..=0x34).step_by(4).map(|offset| (offset, 0, ALL)).collect();
        rows.extend([(0x2c, ALL, ALL), (0x50, 0, ALL)]);
        Self {
            registers: Bank::new(&rows),
            base: 0,
            since: 0,
            divider: 1,
            clock_hz: 1,
            running: false,
            compare_at: None,
        }
    }

    fn count(&self, now: Time) -> u32 {
        if !self.running {
            return self.base;
        }
        let cycles = u128::from(now - self.since) * u128::from(self.clock_hz) / u128::from(SECOND);
        self.base.wrapping_add((cycles / u128::from(self.divider)) as u32)
    }

    pub(crate) fn read(&mut self, offset: u32, now: Time) -> Option<u32> {
        if offset == CNT { Some(self.count(now)) } else { self.registers.read(offset) }
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32, now: Time, clock_hz: u64) -> Option<()> {
        match offset {
            // Flags are cleared by zeros.
            SR => self.registers.set(SR, self.registers.get(SR) & value),
            EGR => {
                if value & 1 != 0 {
                    (self.base, self.since) = (0, now);
                    self.divider = u64::from(self.registers.get(PSC)) + 1;
                }
                // UG and CC1G set UIF and CC1IF.
                self.registers.set(SR, self.registers.get(SR) | value & 3);
            }
            _ => {
                self.registers.write(offset, value)?;
                let count = if offset == CNT { value } else { self.count(now) };
                if offset == CNT || offset == 0 {
                    (self.base, self.since, self.clock_hz) = (count, now, clock_hz);
                    self.running = self.registers.get(0) & 1 != 0;
                }
            }
        }
        if matches!(offset, 0 | EGR | CNT | CCR1) {
            self.plan(now);
        }
        Some(())
    }

    /// When the counter gets to the compare register.
    fn plan(&mut self, now: Time) {
        let counted = u64::from(self.count(now).wrapping_sub(self.base));
        let ahead = u64::from(self.registers.get(CCR1).wrapping_sub(self.count(now)));
        let ahead = if ahead == 0 { 1 << 32 } else { ahead };
        let cycles = u128::from(counted + ahead) * u128::from(self.divider) * u128::from(SECOND);
        let after = cycles.div_ceil(u128::from(self.clock_hz)) as u64;
        self.compare_at = self.running.then_some(self.since + after);
    }

    pub(crate) fn next_event(&self) -> Option<Time> {
        self.compare_at
    }

    pub(crate) fn advance(&mut self, now: Time) {
        if self.compare_at.is_some_and(|at| at <= now) {
            self.registers.set(SR, self.registers.get(SR) | 2);
            self.plan(now);
        }
    }

    pub(crate) fn interrupts(&self) -> bool {
        self.registers.get(SR) & self.registers.get(DIER) & 3 != 0
    }
}
