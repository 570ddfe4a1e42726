//! General-purpose pins (RM0090 and RM0410, 8.4; RM0433, 11.4), and what is connected to them from outside.

use std::collections::BTreeMap;

use crate::bank::{ALL, Bank, bits};
use crate::time::Time;

const PORTS: usize = 11;
const IDR: u32 = 0x10;
const ODR: u32 = 0x14;
const BSRR: u32 = 0x18;

/// A pin: its port, A is 0, and its number.
pub(crate) type Pin = (usize, u32);

/// The PHY's clock: PA1.
pub(crate) const REFERENCE_CLOCK: Pin = (0, 1);

/// The user button, which connects its pin to 3.3 V: PC13.
pub(crate) const BUTTON: Pin = (2, 13);

/// Selects what is at the SPI: PD14. Interrupts: PD15.
pub(crate) const SPI_SELECT: Pin = (3, 14);
pub(crate) const SPI_INTERRUPT: Pin = (3, 15);

/// What drives a pin from outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Drive {
    Level(bool),
    /// A clock, far faster than the program looks.
    Clock,
}

/// All ports.
pub(crate) struct Gpio {
    ports: [Bank; PORTS],
    driven: BTreeMap<Pin, Drive>,
    looks: u32,
    /// Changes of outputs: when, which, and to what.
    changes: BTreeMap<Pin, Vec<(Time, bool)>>,
}

impl Gpio {
    pub(crate) fn new(driven: BTreeMap<Pin, Drive>) -> Self {
        let rows: Vec<_> = (0..=0x24).step_by(4).map(|offset| (offset, 0, ALL)).collect();
        Self { ports: std::array::from_fn(|_| Bank::new(&rows)), driven, looks: 0, changes: BTreeMap::new() }
    }

    /// What is connected from outside; it stays over a reset.
    pub(crate) fn driven(&mut self) -> &mut BTreeMap<Pin, Drive> {
        &mut self.driven
    }

    pub(crate) fn read(&mut self, offset: u32) -> Option<u32> {
        let (port, offset) = (offset as usize / 0x400, offset % 0x400);
        if offset != IDR {
            return self.ports[port].read(offset);
        }
        self.looks += 1;
        Some((0..16).filter(|&pin| self.level((port, pin))).fold(0, |levels, pin| levels | 1 << pin))
    }

    pub(crate) fn level(&self, pin: Pin) -> bool {
        let (port, number) = (&self.ports[pin.0], pin.1);
        match self.driven.get(&pin) {
            _ if bits(port.get(0), 2 * number, 2) == 1 => port.get(ODR) >> number & 1 != 0,
            Some(Drive::Level(level)) => *level,
            Some(Drive::Clock) => self.looks.is_multiple_of(2),
            None => bits(port.get(0xc), 2 * number, 2) == 1,
        }
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32, now: Time) -> Option<()> {
        let (port, offset) = (offset as usize / 0x400, offset % 0x400);
        let bank = &mut self.ports[port];
        let before = bank.get(ODR);
        match offset {
            IDR => {}
            // The upper half resets, the lower half sets and wins.
            BSRR => bank.set(ODR, before & !(value >> 16) | value & 0xffff),
            _ => bank.write(offset, value)?,
        }
        let after = bank.get(ODR);
        for pin in (0..16).filter(|pin| (before ^ after) >> pin & 1 != 0) {
            self.changes.entry((port, pin)).or_default().push((now, after >> pin & 1 != 0));
        }
        Some(())
    }

    /// Whether the program drives a pin.
    pub(crate) fn is_output(&self, (port, number): Pin) -> bool {
        bits(self.ports[port].get(0), 2 * number, 2) == 1
    }

    /// The alternate function of a pin that has one.
    pub(crate) fn function(&self, (port, number): Pin) -> Option<u32> {
        let port = &self.ports[port];
        let register = if number < 8 { 0x20 } else { 0x24 };
        (bits(port.get(0), 2 * number, 2) == 2).then(|| bits(port.get(register), 4 * (number % 8), 4))
    }

    /// When an output was switched, and to what.
    pub(crate) fn changes(&self, pin: Pin) -> &[(Time, bool)] {
        self.changes.get(&pin).map_or(&[], Vec::as_slice)
    }
}
