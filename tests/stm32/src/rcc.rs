//! Reset and clock control: which clock runs, how fast, and why the chip was reset (RM0090 and RM0410, 5.3; RM0433, 8.7).

use crate::bank::{ALL, Bank, bits};
use crate::chip::Family;

/// The clock that the ST-LINK gives to every NUCLEO-144.
const HSE_HZ: u64 = 8_000_000;

/// Why a chip starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reset {
    /// Its supply came.
    Power,
    /// The program asked for it.
    Software,
    /// The independent watchdog was not fed.
    Watchdog,
}

/// Frequencies in hertz.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Clocks {
    /// The processor's.
    pub(crate) core: u64,
    /// Of the slower peripherals' bus: USART2, USART3, UART4, UART5.
    pub(crate) slow: u64,
    /// Of the faster peripherals' bus: USART6, SPI1.
    pub(crate) fast: u64,
    /// Of the timers on the slower bus.
    pub(crate) timers: u64,
    pub(crate) spi: u64,
    /// Of the random numbers; zero if it stands still.
    pub(crate) random: u64,
}

/// The registers of one of the two generations.
pub(crate) struct Rcc {
    h7: bool,
    registers: Bank,
}

/// Oscillators and PLLs of CR: "on" and "ready".
const READY: &[(u32, u32, u32)] =
    &[(0, 0, 1), (0, 16, 17), (0, 24, 25), (0, 26, 27), (0, 28, 29), (0x70, 0, 1), (0x74, 0, 1)];
const READY_H7: &[(u32, u32, u32)] = &[
    (0, 0, 2),
    (0, 7, 8),
    (0, 12, 13),
    (0, 16, 17),
    (0, 24, 25),
    (0, 26, 27),
    (0, 28, 29),
    (0x70, 0, 1),
    (0x74, 0, 1),
];

impl Rcc {
    pub(crate) fn new(family: Family, cause: Reset) -> Self {
        let h7 = family == Family::H7;
        let mut registers = Bank::new(&rows(h7));
        // Every reset pulls the pin as well.
        let (register, power, pin, software, watchdog) = if h7 {
            (0xd0, 1 << 21 | 1 << 23, 1 << 22, 1 << 24, 1 << 26)
        } else {
            (0x74, 3 << 26 | 1 << 25, 1 << 26, 1 << 28, 1 << 29)
        };
        let flags = match cause {
            Reset::Power => power,
            Reset::Software => software,
            Reset::Watchdog => watchdog,
        };
        registers.set(register, registers.get(register) | flags | pin);
        registers.follow(if h7 { READY_H7 } else { READY });
        Self { h7, registers }
    }

    pub(crate) fn read(&self, offset: u32) -> Option<u32> {
        self.registers.read(offset)
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32) -> Option<()> {
        let locked = self.locked(offset);
        let value = self.registers.read(offset)? & locked | value & !locked;
        self.registers.write(offset, value)?;
        self.registers.follow(if self.h7 { READY_H7 } else { READY });
        // The clock in use follows the clock that was chosen.
        let (configuration, count) = if self.h7 { (0x10, 3) } else { (8, 2) };
        let chosen = bits(self.registers.get(configuration), 0, count);
        let mask = ((1 << count) - 1) << count;
        self.registers.set(configuration, self.registers.get(configuration) & !mask | chosen << count);
        // RMVF forgets why the chip was reset.
        let (reasons, forget) = if self.h7 { (0xd0, 1 << 16) } else { (0x74, 1 << 24) };
        if offset == reasons && value & forget != 0 {
            let kept = if self.h7 { 0 } else { self.registers.get(reasons) & 3 };
            self.registers.set(reasons, kept);
        }
        Some(())
    }

    /// Whether a bit of a register is one.
    pub(crate) fn is_set(&self, register: u32, bit: u32) -> bool {
        self.registers.read(register).is_some_and(|value| value >> bit & 1 != 0)
    }

    /// Bits of a register that cannot be written while their PLL is on.
    fn locked(&self, offset: u32) -> u32 {
        let on = |pll: u32| self.registers.get(0) >> (24 + 2 * pll) & 1 != 0;
        match (self.h7, offset) {
            // PLLCKSELR: the source of all, and the divider of each.
            (true, 0x28) => {
                let of_one = |pll: u32| if on(pll) { 3 | 0x3f << (4 + 8 * pll) } else { 0 };
                of_one(0) | of_one(1) | of_one(2)
            }
            (true, 0x30 | 0x38 | 0x40) if on((offset - 0x30) / 8) => ALL,
            (false, 4) if on(0) => ALL,
            _ => 0,
        }
    }

    /// What runs how fast.
    pub(crate) fn clocks(&self) -> Clocks {
        if self.h7 { self.clocks_h7() } else { self.clocks_f() }
    }

    fn clocks_f(&self) -> Clocks {
        let (pll, configuration) = (self.registers.get(4), self.registers.get(8));
        let source = if pll >> 22 & 1 == 1 { HSE_HZ } else { 16_000_000 };
        let system = match bits(configuration, 0, 2) {
            0 => 16_000_000,
            1 => HSE_HZ,
            _ => {
                let divider = u64::from(bits(pll, 16, 2) + 1) * 2;
                source / u64::from(bits(pll, 0, 6).max(1)) * u64::from(bits(pll, 6, 9)) / divider
            }
        };
        let core = system / ahb(bits(configuration, 4, 4));
        let (slow, fast) = (core / apb(bits(configuration, 10, 3)), core / apb(bits(configuration, 13, 3)));
        let vco = source / u64::from(bits(pll, 0, 6).max(1)) * u64::from(bits(pll, 6, 9));
        let divider = u64::from(bits(pll, 24, 4).max(1));
        let random = if self.is_set(0, 25) { vco / divider } else { 0 };
        let timers = if slow == core { slow } else { slow * 2 };
        Clocks { core, slow, fast, timers, spi: fast, random }
    }

    fn clocks_h7(&self) -> Clocks {
        let read = |offset| self.registers.get(offset);
        let hsi = 64_000_000 >> bits(read(0), 3, 2);
        let source = match bits(read(0x28), 0, 2) {
            0 => hsi,
            1 => 4_000_000,
            _ => HSE_HZ,
        };
        let vco = source / u64::from(bits(read(0x28), 4, 6).max(1)) * u64::from(bits(read(0x30), 0, 9) + 1);
        let system = match bits(read(0x10), 0, 3) {
            0 => hsi,
            1 => 4_000_000,
            2 => HSE_HZ,
            _ => vco / u64::from(bits(read(0x30), 9, 7) + 1),
        };
        let core = system / ahb(bits(read(0x18), 8, 4));
        let bus = core / ahb(bits(read(0x18), 0, 4));
        let (slow, fast) = (bus / apb(bits(read(0x1c), 4, 3)), bus / apb(bits(read(0x1c), 8, 3)));
        let spi = vco / u64::from(bits(read(0x30), 16, 7) + 1);
        // HSI48, unless D2CCIP2R chooses another one.
        let random = if self.is_set(0, 13) && bits(read(0x54), 8, 2) == 0 { 48_000_000 } else { 0 };
        let timers = if slow == bus { slow } else { slow * 2 };
        Clocks { core, slow, fast, timers, spi, random }
    }
}

/// The divider of a prescaler field of four bits.
fn ahb(field: u32) -> u64 {
    match field {
        0..8 => 1,
        8..12 => 2 << (field - 8),
        _ => 64 << (field - 12),
    }
}

/// The divider of a prescaler field of three bits.
fn apb(field: u32) -> u64 {
    if field < 4 { 1 } else { 2 << (field - 4) }
}

fn rows(h7: bool) -> Vec<(u32, u32, u32)> {
    if h7 {
        let mut rows = vec![(0, 0x83, ALL), (0x28, 0x0202_0200, ALL), (0x2c, 0x01ff_0000, ALL)];
        rows.extend([0x30, 0x38, 0x40].map(|offset| (offset, 0x0101_0280, ALL)));
        // Configurations, dividers, choices of clocks, resets.
        let plain =
            [0x04, 0x08, 0x10, 0x18, 0x1c, 0x20, 0x34, 0x3c, 0x44, 0x4c, 0x50, 0x54, 0x58, 0x60, 0x64, 0x68];
        rows.extend(plain.map(|offset| (offset, 0, ALL)));
        rows.extend([(0x70, 0, ALL), (0x74, 0, 1), (0xd0, 0, 0)]);
        rows.extend((0x7c..=0xa0).step_by(4).map(|offset| (offset, 0, ALL)));
        rows.extend((0xd4..=0x11c).step_by(4).map(|offset| (offset, 0, ALL)));
        return rows;
    }
    let mut rows =
        vec![(0, 0x83, ALL), (4, 0x2400_3010, ALL), (8, 0, ALL), (0xc, 0, 0), (0x70, 0, ALL), (0x74, 0, 1)];
    // Resets, clocks on, clocks on while asleep; spread spectrum, further PLLs, choices of clocks.
    let ranges = [0x10..=0x18, 0x20..=0x24, 0x30..=0x38, 0x40..=0x44, 0x50..=0x58, 0x60..=0x64, 0x80..=0x90];
    rows.extend(ranges.into_iter().flat_map(|range| range.step_by(4)).map(|offset| (offset, 0, ALL)));
    // The F4's CCM is on (CCMDATARAMEN); the F7's bit of that place is its DTCM's.
    rows.push((0x30, 1 << 20, ALL));
    rows
}
