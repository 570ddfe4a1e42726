//! The program's accesses to peripherals: each goes to the model of its address. What no model knows, and what cannot work, stops the run.

use std::ops::Range;

use crate::bus::{Bus, SPI_BASE};
use crate::chip::{self, Device, Family, UARTS};
use crate::flash::Access;
use crate::gpio::SPI_SELECT;
use crate::wiring;

const ETHERNET_BASE: u32 = 0x4002_8000;

impl Bus {
    fn uart_clock(&self, uart: usize) -> u64 {
        if UARTS[uart].0 == "USART6" { self.clocks.fast } else { self.clocks.slow }
    }

    /// Notes the first thing that stops the run.
    pub(crate) fn complain(&mut self, does: &str, address: u32, what: &str) {
        let name = chip::name(self.board.family, address);
        self.complaint.get_or_insert_with(|| format!("{does} {name} {what},"));
        self.deadline = self.now;
    }

    /// Complains where a peripheral has no clock.
    fn check_clock(&mut self, device: Device, address: u32, offset: u32) {
        let clock = wiring::clock(self.board.family, device, offset);
        if clock.is_some_and(|(register, bit)| !self.rcc.is_set(register, bit)) {
            self.complain("accesses", address, "which has no clock");
        }
    }

    /// Complains where the pins of what is used are not its own.
    pub(crate) fn check_pins(&mut self) {
        for (uart, (_, base, _)) in UARTS.into_iter().enumerate() {
            let used = self.uarts[uart].take_used();
            let (receive, transmit, driver) = wiring::uart(self.board.family, uart);
            let switches = driver.filter(|_| self.uarts[uart].switches_driver());
            let pins = [
                used.received.then_some(receive),
                used.sent.then_some(transmit),
                switches.filter(|_| used.sent),
            ];
            self.check_functions(base, pins.into_iter().flatten());
        }
        if self.target.is_some() && self.spi.next_event().is_some() {
            self.check_functions(SPI_BASE, wiring::SPI);
        }
        if self.ethernet.is_sending() {
            self.check_functions(ETHERNET_BASE, wiring::ETHERNET);
        }
    }

    fn check_functions(&mut self, base: u32, pins: impl IntoIterator<Item = wiring::Function>) {
        for (pin, function) in pins {
            if self.gpio.function(pin) != Some(function) {
                let port = char::from(b'A' + pin.0 as u8);
                let what =
                    format!("the pin P{port}{} of which has not the alternate function {function}", pin.1);
                self.complain("uses", base, &what);
            }
        }
    }

    /// The program reads a peripheral's register or the settings' cells.
    pub(crate) fn read(&mut self, address: u32, bytes: usize) -> u64 {
        self.accesses.0 += 1;
        if is_cell(address) {
            self.touch_flash(Some(address));
            let value = self.flash.read_cells(address, bytes).map(|value| value ^ self.corruption(address));
            if value.is_none() && !self.core.ignores_bus_faults() {
                (self.bus_fault, self.deadline) = (Some(address), self.now);
            }
            return value.unwrap_or_default();
        }
        self.register(address, bytes).map(u64::from).unwrap_or_else(|| {
            self.complain("reads", address, "a register without a model");
            0
        })
    }

    /// What is read wrong of the F4's second bank before revision 3, unless PA12 is low (errata 2.2.11).
    fn corruption(&self, address: u32) -> u64 {
        let is_held_low = self.gpio.is_output((0, 12)) && !self.gpio.level((0, 12));
        let is_affected = self.board.family == Family::F4 && self.revision < 0x2001;
        u64::from(is_affected && !is_held_low && address >= chip::FLASH + chip::FLASH_BYTES / 2)
    }

    fn register(&mut self, address: u32, bytes: usize) -> Option<u32> {
        let (device, offset) = chip::device(self.board.family, address)?;
        self.check_clock(device, address, offset);
        match device {
            Device::Rcc => self.rcc.read(offset),
            Device::Pwr => self.pwr.read(offset),
            Device::Flash => {
                self.waits_for_flash = self.flash.shows_busy(offset);
                self.flash.read(offset)
            }
            Device::Syscfg => self.syscfg.read(offset),
            Device::Exti => self.exti.read(offset),
            Device::Gpio => self.gpio.read(offset),
            Device::Watchdog => self.watchdog.read(offset),
            Device::Timer => self.timer.read(offset, self.now),
            Device::Random => self.random.read(offset, self.now),
            Device::Uart(uart) => self.uarts[uart].read(offset),
            Device::Dma(dma) => self.dma.read(dma, offset),
            Device::Dmamux => self.dma.read_mux(offset),
            Device::Spi => self.spi.read(offset),
            Device::Core => self.core.read(offset, bytes, self.now, self.clocks.core),
            Device::AxiTarget => self.axi.read(offset),
            Device::Debug => self.debug(offset),
            Device::System => self.unique(address),
            Device::Ethernet => self.ethernet.read(offset),
        }
    }

    /// DBGMCU: the chip's device and revision.
    fn debug(&self, offset: u32) -> Option<u32> {
        let device = match self.board.family {
            Family::F4 => 0x419,
            Family::F7 => 0x451,
            Family::H7 => 0x450,
        };
        match offset {
            0 => Some(u32::from(self.revision) << 16 | device),
            // What stops while a debugger holds the processor.
            4..=0x60 => Some(0),
            _ => None,
        }
    }

    fn unique(&self, address: u32) -> Option<u32> {
        /// Coordinates on the wafer, and the lot's number.
        const NUMBER: [u8; 12] = *b"\x2a\0\x31\0\x0eQ85019 ";
        let at = address.checked_sub(self.board.unique)? as usize;
        // Read by words or by bytes.
        let rest = NUMBER.get(at..)?;
        Some(rest.iter().take(4).rev().fold(0, |word, &byte| word << 8 | u32::from(byte)))
    }

    /// The program writes a register or the settings' cells.
    pub(crate) fn write(&mut self, address: u32, bytes: usize, value: u64) {
        self.accesses.1 += 1;
        if is_cell(address) {
            self.touch_flash(Some(address));
            self.flash.write_cells(address, bytes, value, self.now);
            self.touch_flash(None);
        } else if self.set_register(address, bytes, value as u32).is_none() {
            self.complain("writes", address, "a register without a model");
        }
        let (active, length) = self.board.active;
        let is_code = |changed: &Range<u32>| (active..active + length).contains(&changed.start);
        if self.flash.cells.changed.as_ref().is_some_and(is_code) {
            self.core.caches.change_instructions();
        }
        if let Some(rule) = self.core.caches.broken_rule.take() {
            self.complaint.get_or_insert_with(|| rule.to_owned());
        }
        // What follows from it follows before the next instructions.
        self.deadline = self.now;
    }

    fn set_register(&mut self, address: u32, bytes: usize, value: u32) -> Option<()> {
        let (device, offset) = chip::device(self.board.family, address)?;
        self.check_clock(device, address, offset);
        let now = self.now;
        match device {
            Device::Rcc => self.rcc.write(offset, value).map(|()| self.follow_clocks()),
            Device::Pwr => self.pwr.write(offset, value),
            Device::Flash => self.flash.write(offset, value, now).map(|()| self.touch_flash(None)),
            Device::Syscfg => self.syscfg.write(offset, value),
            Device::Exti => self.exti.write(offset, value),
            Device::Gpio => {
                let before = self.gpio.level(SPI_SELECT);
                self.gpio.write(offset, value, now)?;
                let after = self.gpio.level(SPI_SELECT);
                if let Some(target) = self.target.as_mut().filter(|_| before != after) {
                    target.select(!after, now);
                }
                Some(())
            }
            Device::Watchdog => self.watchdog.write(offset, value, now),
            Device::Timer => self.timer.write(offset, value, now, self.clocks.timers),
            Device::Random => self.random.write(offset, value, now, self.clocks.random),
            Device::Uart(uart) => {
                let clock = self.uart_clock(uart);
                self.uarts[uart].write(offset, value, now, clock)
            }
            Device::Dma(dma) => self.dma.write(dma, offset, value),
            Device::Dmamux => self.dma.write_mux(offset, value),
            Device::Spi => self.spi.write(offset, value, now, self.clocks.spi),
            Device::Core => self.core.write(offset, value, bytes),
            Device::AxiTarget => self.axi.write(offset, value),
            Device::Debug => (offset <= 0x60).then_some(()),
            Device::Ethernet => self.ethernet.write(offset, value, now),
            Device::System => None,
        }
    }

    /// The processor stands still if its own bank of the flash is busy, or the one that it accesses at `address`.
    fn touch_flash(&mut self, address: Option<u32>) {
        if let Access::Stall(until) = self.flash.access(address) {
            self.stalled_until = self.stalled_until.max(until);
            self.deadline = self.now;
            if address.is_some() {
                // The access itself waits.
                self.flash.advance(until);
            }
        }
    }
}

/// Whether `address` is in the flash.
fn is_cell(address: u32) -> bool {
    (chip::FLASH..chip::FLASH + chip::FLASH_BYTES).contains(&address)
}

#[cfg(test)]
mod tests {
    use crate::bus::Bus;
    use crate::cells::Cells;
    use crate::chip::{NUCLEO_F429ZI, NUCLEO_F767ZI, NUCLEO_H743ZI};
    use crate::phy::Phy;

    #[test]
    fn what_no_model_knows_and_what_has_no_clock_is_named() {
        for board in [NUCLEO_F429ZI, NUCLEO_F767ZI, NUCLEO_H743ZI] {
            let complaint = |access: fn(&mut Bus)| {
                let mut bus = Bus::new(board, Phy::new(true), Cells::new());
                access(&mut bus);
                bus.complaint.unwrap()
            };
            // CAN1, and the console's UART before its clock is on.
            assert_eq!(
                complaint(|bus| _ = bus.read(0x4000_6400, 4)),
                "reads 0x40006400 a register without a model,"
            );
            let no_clock = complaint(|bus| bus.write(0x4000_4808, 4, 0));
            assert_eq!(no_clock, "accesses 0x40004808, which is USART3 + 0x8, which has no clock,");
        }
    }
}
