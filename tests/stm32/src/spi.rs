//! SPI1 as a controller, of the older generation and of the H7's (RM0090, 28; RM0410, 35; RM0433, 50). Nothing is connected, so that each
//! bit is read as one.

use crate::bank::{ALL, Bank, bits};
use crate::time::{SECOND, Time};

const RXP: u32 = 1;
const TXP: u32 = 2;
const EOT: u32 = 1 << 3;
const TXC: u32 = 1 << 12;

/// The SPI.
pub(crate) struct Spi {
    h7: bool,
    registers: Bank,
    /// Frames received, frames being sent: when the first of them ends.
    received: u32,
    sending: u32,
    ends_at: Option<Time>,
    clock_hz: u64,
    /// Frames of the H7's transfer that have been written and that were taken.
    left: Option<u32>,
}

impl Spi {
    pub(crate) fn new(h7: bool) -> Self {
        let last = if h7 { 0x50 } else { 0x20 };
        let mut rows: Vec<_> = (0..=last).step_by(4).map(|offset| (offset, 0, ALL)).collect();
        if !h7 {
            rows.push((4, 0x700, ALL));
        }
        Self {
            h7,
            registers: Bank::new(&rows),
            received: 0,
            sending: 0,
            ends_at: None,
            clock_hz: 1,
            left: None,
        }
    }

    fn frame(&self) -> Time {
        let (control, divider) =
            if self.h7 { (self.registers.get(8), 28) } else { (self.registers.get(0), 3) };
        8 * SECOND * (2 << bits(control, divider, 3)) / self.clock_hz
    }

    fn is_on(&self) -> bool {
        if self.h7 { self.registers.get(0) & 0x201 == 0x201 } else { self.registers.get(0) & 1 << 6 != 0 }
    }

    fn status(&self) -> u32 {
        if self.h7 {
            let complete = if self.sending == 0 { TXC } else { 0 };
            let end = if self.left == Some(0) && self.sending == 0 { EOT } else { 0 };
            return if self.received > 0 { RXP } else { 0 } | TXP | complete | end;
        }
        // The FIFOs' levels of the F7 are in bits 9 to 12.
        let busy = if self.sending > 0 { 1 << 7 | 1 << 11 } else { 0 };
        let received = if self.received > 0 { 1 | 1 << 9 } else { 0 };
        received | if self.sending < 2 { 2 } else { 0 } | busy
    }

    pub(crate) fn read(&mut self, offset: u32) -> Option<u32> {
        let (status, data) = if self.h7 { (0x14, 0x30) } else { (8, 0xc) };
        if offset == status {
            return Some(self.status());
        }
        if offset == data {
            self.received = self.received.saturating_sub(1);
            return Some(0xff);
        }
        self.registers.read(offset)
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32, now: Time, clock_hz: u64) -> Option<()> {
        self.clock_hz = clock_hz;
        match (self.h7, offset) {
            (true, 0x20) | (false, 0xc) => {
                self.sending += 1;
                self.left = self.left.map(|left| left.saturating_sub(1));
            }
            (true, 0x14) | (false, 8) | (true, 0x18) => {}
            _ => self.registers.write(offset, value)?,
        }
        if self.h7 && offset == 0 {
            if value & 1 == 0 {
                (self.received, self.sending, self.left, self.ends_at) = (0, 0, None, None);
                self.registers.set(0, value & !0x200);
            } else if value & 0x200 != 0 {
                self.left = Some(bits(self.registers.get(4), 0, 16)).filter(|&frames| frames > 0);
            }
        }
        if self.sending > 0 && self.ends_at.is_none() && self.is_on() {
            self.ends_at = Some(now + self.frame());
        }
        Some(())
    }

    pub(crate) fn next_event(&self) -> Option<Time> {
        self.ends_at
    }

    pub(crate) fn advance(&mut self, now: Time) {
        let Some(at) = self.ends_at.filter(|&at| at <= now) else { return };
        self.sending -= 1;
        self.received += 1;
        self.ends_at = (self.sending > 0).then(|| at + self.frame());
    }

    /// A frame waits to be taken by DMA.
    pub(crate) fn wants_to_give(&self) -> bool {
        let enabled = if self.h7 { self.registers.get(8) >> 14 & 1 } else { self.registers.get(4) & 1 };
        self.received > 0 && enabled != 0
    }

    /// A frame from DMA can be sent.
    pub(crate) fn wants_to_take(&self) -> bool {
        let enabled = if self.h7 { self.registers.get(8) >> 15 & 1 } else { self.registers.get(4) >> 1 & 1 };
        enabled != 0 && self.sending < 2 && self.is_on()
    }

    /// Offsets of the registers that DMA reads and writes.
    pub(crate) fn data_offsets(&self) -> (u32, u32) {
        if self.h7 { (0x30, 0x20) } else { (0xc, 0xc) }
    }

    pub(crate) fn interrupts(&self) -> bool {
        self.h7 && self.registers.get(0x10) & self.status() & 0x3ff != 0
    }
}
