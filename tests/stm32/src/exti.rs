//! External interrupts (RM0090, 12; RM0410, 11; RM0433, 20), of lines 10 to 15.

use crate::bank::{ALL, Bank};

/// The registers; those of the H7 are elsewhere.
pub(crate) struct Exti {
    registers: Bank,
    mask: u32,
    rising: u32,
    falling: u32,
    pending: u32,
}

/// Lines that share the one interrupt that is used.
const SHARED: u32 = 0xfc00;

impl Exti {
    pub(crate) fn new(h7: bool) -> Self {
        let rows: Vec<_> = (0..=0xa8).step_by(4).map(|offset| (offset, 0, ALL)).collect();
        let registers = Bank::new(&rows);
        if h7 {
            Self { registers, mask: 0x80, rising: 0, falling: 4, pending: 0x88 }
        } else {
            Self { registers, mask: 0, rising: 8, falling: 0xc, pending: 0x14 }
        }
    }

    pub(crate) fn read(&self, offset: u32) -> Option<u32> {
        self.registers.read(offset)
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32) -> Option<()> {
        if offset == self.pending {
            // Cleared by ones.
            self.registers.set(offset, self.registers.get(offset) & !value);
            return Some(());
        }
        self.registers.write(offset, value)
    }

    /// The level of the pin of a line has changed.
    pub(crate) fn edge(&mut self, line: u32, is_high: bool) {
        let edges = self.registers.get(if is_high { self.rising } else { self.falling });
        self.registers.set(self.pending, self.registers.get(self.pending) | edges & 1 << line);
    }

    pub(crate) fn interrupts(&self) -> bool {
        self.registers.get(self.pending) & self.registers.get(self.mask) & SHARED != 0
    }
}
