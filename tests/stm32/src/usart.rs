//! A USART of either generation (RM0090, 30; RM0410, 34; RM0433, 48), with the wire that it is on.
//!
//! A character that is written leaves bit by bit at the rate that clock and divider give; one that arrives sets its flags when
//! its stop bit has passed. The driver's signal has its times before and after, in sixteenths of a bit.

use std::collections::VecDeque;

use crate::bank::{ALL, Bank, bits};
use crate::character::{Character, Format, Parity};
use crate::time::{NANOSECOND, Time};

// Flags, which both generations have at the same places.
const PE: u32 = 1;
const FE: u32 = 1 << 1;
/// NF, or NE.
const NF: u32 = 1 << 2;
const ORE: u32 = 1 << 3;
const IDLE: u32 = 1 << 4;
const RXNE: u32 = 1 << 5;
const TC: u32 = 1 << 6;
const TXE: u32 = 1 << 7;

/// How long DMA takes to arbitrate and to read a character (AN4031, 2: some ten cycles of the bus).
const DMA_TAKES: Time = 50 * NANOSECOND;

/// A character that the board sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sent {
    /// From the start bit's beginning to the last stop bit's end.
    pub(crate) begin: Time,
    pub(crate) end: Time,
    pub(crate) character: Character,
}

/// What a USART's pins were used for.
#[derive(Clone, Copy, Default)]
pub(crate) struct Used {
    pub(crate) received: bool,
    pub(crate) sent: bool,
}

/// Offsets of the registers that differ between the generations.
struct Layout {
    control: [u32; 3],
    divider: u32,
    status: u32,
    clear: Option<u32>,
    receive: u32,
    transmit: u32,
}

const OLD: Layout =
    Layout { control: [0xc, 0x10, 0x14], divider: 8, status: 0, clear: None, receive: 4, transmit: 4 };
const NEW: Layout = Layout {
    control: [0, 4, 8],
    divider: 0xc,
    status: 0x1c,
    clear: Some(0x20),
    receive: 0x24,
    transmit: 0x28,
};

pub(crate) struct Usart {
    layout: &'static Layout,
    registers: Bank,
    flags: u32,
    clock_hz: u64,
    received: u32,
    /// Flags of the F4 go when they were seen in the status register and then the data register is read.
    seen: u32,
    waiting: Option<u8>,
    shifting: Option<Sent>,
    driver_off_at: Option<Time>,
    idle_at: Option<Time>,
    /// When DMA takes the character in the data register.
    taken_at: Option<Time>,
    /// What other stations send: when each character ends, and whether one of the three samples of a bit is wrong.
    incoming: VecDeque<(Time, Character, bool)>,
    pub(crate) sent: Vec<Sent>,
    /// When the USART itself switched the transceiver's driver.
    pub(crate) driver: Vec<(Time, bool)>,
    /// An interrupt came, and may be gone already.
    pub(crate) pulse: bool,
    used: Used,
}

impl Usart {
    pub(crate) fn new(is_new: bool) -> Self {
        let last = if is_new { 0x2c } else { 0x18 };
        let rows: Vec<_> = (0..=last).step_by(4).map(|offset| (offset, 0, ALL)).collect();
        Self {
            layout: if is_new { &NEW } else { &OLD },
            registers: Bank::new(&rows),
            flags: TC | TXE,
            clock_hz: 1,
            received: 0,
            seen: 0,
            waiting: None,
            shifting: None,
            driver_off_at: None,
            idle_at: None,
            taken_at: None,
            incoming: VecDeque::new(),
            sent: Vec::new(),
            driver: Vec::new(),
            pulse: false,
            used: Used::default(),
        }
    }

    /// After the chip's reset; what is on the wire stays there.
    pub(crate) fn reset(&mut self) {
        let fresh = Self::new(self.layout.clear.is_some());
        let driver_was_on = self.driver.last().is_some_and(|&(_, on)| on);
        let old = std::mem::replace(self, fresh);
        (self.incoming, self.sent, self.driver) = (old.incoming, old.sent, old.driver);
        if let (true, Some(&(at, _))) = (driver_was_on, self.driver.last()) {
            self.driver.push((at, false));
        }
    }

    fn control(&self, number: usize) -> u32 {
        self.registers.get(self.layout.control[number - 1])
    }

    /// UE.
    fn is_on(&self) -> bool {
        self.control(1) & if self.layout.clear.is_some() { 1 } else { 1 << 13 } != 0
    }

    /// Speed and format that it is set to.
    pub(crate) fn format(&self) -> Format {
        let (control, divider) = (self.control(1), u64::from(self.registers.get(self.layout.divider)));
        let parity = match bits(control, 9, 2) {
            2 => Parity::Even,
            3 => Parity::Odd,
            _ => Parity::None,
        };
        // M0, and M1 of the newer generation.
        let word = match (control >> 12 & 1, self.layout.clear.is_some() && control >> 28 & 1 != 0) {
            (1, _) => 9,
            (_, true) => 7,
            _ => 8,
        };
        let stop_bits = if bits(self.control(2), 12, 2) == 2 { 2 } else { 1 };
        let baud = if control >> 15 & 1 != 0 {
            2 * self.clock_hz / (divider & !0xf | (divider & 7) << 1).max(1)
        } else {
            self.clock_hz / divider.max(1)
        };
        let data_bits = word - u32::from(parity != Parity::None);
        Format { baud, data_bits, parity, stop_bits }
    }

    pub(crate) fn read(&mut self, offset: u32) -> Option<u32> {
        if offset == self.layout.status {
            self.seen = self.flags;
            return Some(self.flags);
        }
        if offset != self.layout.receive {
            return self.registers.read(offset);
        }
        self.flags &= !RXNE;
        if self.layout.clear.is_none() {
            self.flags &= !(std::mem::take(&mut self.seen) & (PE | FE | NF | ORE | IDLE));
        }
        Some(self.received)
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32, now: Time, clock_hz: u64) -> Option<()> {
        self.clock_hz = clock_hz;
        if offset == self.layout.transmit {
            // The F4's TC goes where the status register, read before, had it set.
            let is_complete = if self.layout.clear.is_none() { self.seen & TC } else { TC };
            self.flags &= !(TXE | is_complete);
            self.waiting = Some(value as u8);
            self.shift(now);
        } else if offset == self.layout.status {
            // Of the F4: RXNE and TC are cleared by zeros. The newer ones' cannot be written.
            if self.layout.clear.is_none() {
                self.flags &= value | !(RXNE | TC);
            }
        } else if Some(offset) == self.layout.clear {
            self.flags &= !(value & (PE | FE | NF | ORE | IDLE | TC));
        } else if self.layout.clear.is_some() && offset == 0x18 {
            // RQR: requests; the receiver's data is dropped.
            self.flags &= if value & 8 != 0 { !RXNE } else { ALL };
        } else {
            self.registers.write(offset, value)?;
            // TEACK and REACK follow.
            if self.layout.clear.is_some() {
                let enabled = if self.is_on() { bits(self.control(1), 2, 2) } else { 0 };
                let acknowledged = (enabled >> 1) << 21 | (enabled & 1) << 22;
                self.flags = self.flags & !(3 << 21) | acknowledged;
            }
        }
        Some(())
    }

    /// Begins to send what waits, if nothing is being sent.
    fn shift(&mut self, now: Time) {
        if self.shifting.is_some() || !self.is_on() || self.control(1) & 8 == 0 {
            return;
        }
        let Some(data) = self.waiting.take() else { return };
        let format = self.format();
        let mut begin = now;
        if self.switches_driver()
            && self.driver_off_at.take().is_none()
            && self.driver.last().is_none_or(|&(_, on)| !on)
        {
            self.driver.push((now, true));
            begin += format.time(bits(self.control(1), 21, 5)) / 16;
        }
        // What is on the wire has no more bits than the format has.
        let data = if format.data_bits == 7 { data & 0x7f } else { data };
        let end = begin + format.time(format.bits());
        self.shifting = Some(Sent { begin, end, character: Character { format, data } });
        self.flags |= TXE;
    }

    /// Another station sends `character`, which ends at `end`, with noise or without.
    pub(crate) fn arrive(&mut self, end: Time, character: Character, is_noisy: bool) {
        self.incoming.push_back((end, character, is_noisy));
    }

    /// When the last character that was given to [`Self::arrive`] ends.
    pub(crate) fn arrives_until(&self) -> Option<Time> {
        self.incoming.back().map(|&(end, ..)| end)
    }

    pub(crate) fn next_event(&self) -> Option<Time> {
        let shifted = self.shifting.as_ref().map(|sent| sent.end);
        let arrived = self.incoming.front().map(|&(end, ..)| end);
        [shifted, arrived, self.driver_off_at, self.idle_at, self.taken_at].into_iter().flatten().min()
    }

    pub(crate) fn advance(&mut self, now: Time) {
        if let Some(sent) = self.shifting.filter(|sent| sent.end <= now) {
            self.shifting = None;
            self.sent.push(sent);
            self.used.sent = true;
            if self.waiting.is_some() {
                self.shift(sent.end);
            } else {
                self.flags |= TC;
                let after = sent.character.format.time(bits(self.control(1), 16, 5)) / 16;
                self.driver_off_at = self.switches_driver().then_some(sent.end + after);
            }
        }
        if let Some(at) = self.driver_off_at.filter(|&at| at <= now) {
            self.driver_off_at = None;
            self.driver.push((at, false));
        }
        if let Some(at) = self.idle_at.take_if(|at| *at <= now) {
            // No start bit within a character's time.
            let begins = self.incoming.front().map(|(end, character, _)| end - character.time());
            self.flags |= if begins.is_none_or(|begin| begin >= at) { IDLE } else { 0 };
        }
        self.taken_at.take_if(|at| *at <= now);
        while let Some((end, character, is_noisy)) = self.incoming.pop_front_if(|&mut (end, ..)| end <= now) {
            self.hear(end, character, is_noisy);
        }
    }

    fn hear(&mut self, end: Time, character: Character, is_noisy: bool) {
        let control = self.control(1);
        if !self.is_on() || control & 4 == 0 {
            return;
        }
        self.used.received = true;
        let format = self.format();
        let heard = character.heard_as(&format);
        self.idle_at = Some(end + format.time(format.bits()));
        let detects_overruns = self.layout.clear.is_none() || self.control(3) >> 12 & 1 == 0;
        self.flags |= if heard.parity_error { PE } else { 0 } | if heard.framing_error { FE } else { 0 };
        // The two other samples make the bit what it is. ONEBIT: there is but one.
        self.flags |= if is_noisy && self.control(3) >> 11 & 1 == 0 { NF } else { 0 };
        if self.flags & RXNE != 0 && detects_overruns {
            self.flags |= ORE;
        } else {
            self.flags |= RXNE;
            // The parity bit is read along with seven bits of data.
            self.received = u32::from(heard.data);
            self.taken_at = Some(end + DMA_TAKES);
        }
        // DMA may take the character before the interrupt is served.
        self.pulse |= self.interrupts();
    }

    /// A character waits to be taken by DMA.
    pub(crate) fn wants_to_give(&self) -> bool {
        self.flags & RXNE != 0 && self.taken_at.is_none() && self.control(3) >> 6 & 1 != 0
    }

    /// A character from DMA can be sent.
    pub(crate) fn wants_to_take(&self) -> bool {
        self.waiting.is_none() && self.control(3) >> 7 & 1 != 0 && self.is_on()
    }

    pub(crate) fn interrupts(&self) -> bool {
        let (control, error) = (self.control(1), self.control(3) & 1 != 0);
        let enabled = if control >> 8 & 1 != 0 { PE } else { 0 }
            | if control >> 7 & 1 != 0 { TXE } else { 0 }
            | if control >> 6 & 1 != 0 { TC } else { 0 }
            | if control >> 5 & 1 != 0 { RXNE | ORE } else { 0 }
            | if control >> 4 & 1 != 0 { IDLE } else { 0 }
            | if error { FE | NF | ORE } else { 0 };
        self.flags & enabled != 0
    }

    /// NF.
    pub(crate) fn has_noise(&self) -> bool {
        self.flags & NF != 0
    }

    /// What the pins were used for since this was last asked.
    pub(crate) fn take_used(&mut self) -> Used {
        std::mem::take(&mut self.used)
    }

    /// Whether it switches a transceiver's driver by itself.
    pub(crate) fn switches_driver(&self) -> bool {
        self.layout.clear.is_some() && self.control(3) >> 14 & 1 != 0
    }

    /// Addresses of the registers that DMA reads and writes.
    pub(crate) fn data_offsets(&self) -> (u32, u32) {
        (self.layout.receive, self.layout.transmit)
    }
}
