//! SPI1 as a controller, of the older generation and of the H7's (RM0090, 28; RM0410, 35; RM0433, 50), with what is connected to it.

use std::collections::VecDeque;

use crate::bank::{ALL, Bank, bits};
use crate::time::{SECOND, Time};

const RXP: u32 = 1;
const TXP: u32 = 2;
const EOT: u32 = 1 << 3;
const TXC: u32 = 1 << 12;
/// Frames that wait on each side: of the H7 sixteen; of the F4 one, of the F7 four, which makes no difference for DMA.
const FIFO_FRAMES: (usize, usize) = (2, 16);

/// What is connected to the SPI, to one pin that selects it, and to one that it interrupts by.
pub(crate) trait Target {
    /// The select line goes low, or high.
    fn select(&mut self, is_low: bool, at: Time);
    /// A byte goes out, and another comes back.
    fn exchange(&mut self, out: u8, at: Time) -> u8;
    /// The level of the interrupt pin.
    fn interrupt(&self, at: Time) -> bool;
}

pub(crate) struct Spi {
    h7: bool,
    registers: Bank,
    received: VecDeque<u8>,
    waiting: VecDeque<u8>,
    /// When the byte that is being sent ends.
    shifting: Option<(Time, u8)>,
    clock_hz: u64,
    /// Frames of the H7's transfer that are not clocked yet, where their number was told.
    left: Option<u32>,
}

impl Spi {
    pub(crate) fn new(h7: bool) -> Self {
        let last = if h7 { 0x50 } else { 0x20 };
        let mut rows: Vec<_> = (0..=last).step_by(4).map(|offset| (offset, 0, ALL)).collect();
        if !h7 {
            rows.push((4, 0x700, ALL));
        }
        let (received, waiting) = (VecDeque::new(), VecDeque::new());
        Self { h7, registers: Bank::new(&rows), received, waiting, shifting: None, clock_hz: 1, left: None }
    }

    fn byte(&self) -> Time {
        let (control, divider) =
            if self.h7 { (self.registers.get(8), 28) } else { (self.registers.get(0), 3) };
        8 * SECOND * (2 << bits(control, divider, 3)) / self.clock_hz
    }

    fn is_on(&self) -> bool {
        if self.h7 { self.registers.get(0) & 0x201 == 0x201 } else { self.registers.get(0) & 1 << 6 != 0 }
    }

    fn room(&self) -> usize {
        if self.h7 { FIFO_FRAMES.1 } else { FIFO_FRAMES.0 }
    }

    fn status(&self) -> u32 {
        let is_idle = self.waiting.is_empty() && self.shifting.is_none();
        let received = if self.received.is_empty() { 0 } else { RXP };
        let room = if self.waiting.len() < self.room() { TXP } else { 0 };
        if self.h7 {
            let complete = if is_idle { TXC } else { 0 };
            let end = if is_idle && self.left == Some(0) { EOT } else { 0 };
            return received | room | complete | end;
        }
        // The levels of the F7's FIFOs are in bits 9 to 12.
        let levels =
            if received != 0 { 1 << 9 } else { 0 } | if self.waiting.is_empty() { 0 } else { 1 << 11 };
        received | room | levels | if is_idle { 0 } else { 1 << 7 }
    }

    pub(crate) fn read(&mut self, offset: u32) -> Option<u32> {
        let (status, data) = if self.h7 { (0x14, 0x30) } else { (8, 0xc) };
        if offset == status {
            return Some(self.status());
        }
        if offset == data {
            return Some(self.received.pop_front().unwrap_or_default().into());
        }
        self.registers.read(offset)
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32, now: Time, clock_hz: u64) -> Option<()> {
        self.clock_hz = clock_hz;
        match (self.h7, offset) {
            (true, 0x20) | (false, 0xc) => self.waiting.push_back(value as u8),
            (true, 0x14) | (false, 8) | (true, 0x18) => {}
            _ => self.registers.write(offset, value)?,
        }
        if self.h7 && offset == 0 {
            if value & 1 == 0 {
                self.received.clear();
                self.waiting.clear();
                (self.shifting, self.left) = (None, None);
                self.registers.set(0, value & !0x200);
            } else if value & 0x200 != 0 {
                self.left = Some(bits(self.registers.get(4), 0, 16)).filter(|&frames| frames > 0);
            }
        }
        self.shift(now);
        Some(())
    }

    /// Begins to send what waits, or nothing where only receiving is wanted.
    fn shift(&mut self, now: Time) {
        if self.shifting.is_some() || !self.is_on() || self.left == Some(0) {
            return;
        }
        let only_receives = self.h7 && bits(self.registers.get(0xc), 17, 2) == 2;
        let out = if only_receives { Some(0) } else { self.waiting.pop_front() };
        if let Some(out) = out {
            self.left = self.left.map(|left| left - 1);
            self.shifting = Some((now + self.byte(), out));
        }
    }

    pub(crate) fn next_event(&self) -> Option<Time> {
        self.shifting.map(|(at, _)| at)
    }

    pub(crate) fn advance(&mut self, now: Time, target: Option<&mut (dyn Target + 'static)>) {
        let Some((at, out)) = self.shifting.take_if(|(at, _)| *at <= now) else { return };
        // Nobody drives the line: ones.
        let back = target.map_or(0xff, |target| target.exchange(out, at));
        if self.received.len() < self.room() {
            self.received.push_back(back);
        }
        self.shift(at);
    }

    /// A byte waits to be taken by DMA.
    pub(crate) fn wants_to_give(&self) -> bool {
        let enabled = if self.h7 { self.registers.get(8) >> 14 & 1 } else { self.registers.get(4) & 1 };
        !self.received.is_empty() && enabled != 0
    }

    /// A byte from DMA can be sent.
    pub(crate) fn wants_to_take(&self) -> bool {
        let enabled = if self.h7 { self.registers.get(8) >> 15 & 1 } else { self.registers.get(4) >> 1 & 1 };
        enabled != 0 && self.waiting.len() < self.room() && self.is_on()
    }

    /// Offsets of the registers that DMA reads and writes.
    pub(crate) fn data_offsets(&self) -> (u32, u32) {
        if self.h7 { (0x30, 0x20) } else { (0xc, 0xc) }
    }

    pub(crate) fn interrupts(&self) -> bool {
        self.h7 && self.registers.get(0x10) & self.status() & 0x3ff != 0
    }
}
