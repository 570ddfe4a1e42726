//! The LAN9252 as its driver sees it: an SPI device in front of the emulated controller chip, and an interrupt pin.
//!
//! `spi` decodes a transaction byte by byte into instruction and address of the system registers (`device`). Some of them control
//! engines with latency: `csr` accesses ESC registers, and `fifo` moves process data through FIFOs of sixteen double words. Misuse
//! by the driver is recorded and fails the test that asks ([`Lan9252::check`]).

mod conditions;
mod csr;
mod device;
mod fifo;
mod spi;

use std::cell::RefCell;
use std::rc::Rc;

use ethercat_subdevice::lan9252::{Lan9252 as Driver, Wiring};

use crate::{Interrupt, SharedChip, now};
pub use conditions::{SpiFaults, Timing, Traffic};
use device::Device;
use mobgate_world::random::Random;
pub use spi::{Pins, Spi};

/// A test's handle on the chip, to set faults and read counters.
#[derive(Clone)]
pub struct Lan9252(Rc<RefCell<Device>>);

impl Lan9252 {
    /// A chip in front of `chip`, just out of reset.
    pub fn new(chip: SharedChip, timing: Timing) -> Self {
        Self(Rc::new(RefCell::new(Device::new(chip, timing, now()))))
    }

    /// The same on a board with a pull-up at the interrupt pin instead of a pull-down.
    #[must_use]
    pub fn pulled_up(self) -> Self {
        self.0.borrow_mut().pulled_up = true;
        self
    }

    /// The processor's SPI.
    pub fn spi(&self) -> Spi {
        Spi::new(self.0.clone())
    }

    /// The same pin by pin.
    pub fn pins(&self) -> Pins {
        Pins::new(self.0.clone())
    }

    /// The interrupt pin.
    pub fn interrupt(&self) -> Interrupt {
        let device = self.0.clone();
        let chip = device.borrow().chip.clone();
        Interrupt::with_level(chip, move |at| device.borrow_mut().pin(at))
    }

    /// The level of the interrupt pin.
    pub fn interrupt_is_high(&self) -> bool {
        self.0.borrow_mut().pin(now())
    }

    /// Enables `faults`, drawn from `random`. Misuse that they cause is not recorded.
    pub fn set_faults(&self, faults: SpiFaults, random: Random) {
        let mut device = self.0.borrow_mut();
        device.faults = faults;
        device.random = random;
    }

    /// Resets the chip as a brown-out does.
    pub fn reset(&self) {
        let mut device = self.0.borrow_mut();
        device.tainted = true;
        device.reset(now());
    }

    /// Makes the register access engine hang until the chip is reset.
    pub fn hang_registers(&self) {
        self.0.borrow_mut().csr.hang();
    }

    /// Makes the process data engines hang until the chip is reset.
    pub fn hang_transfers(&self) {
        let mut device = self.0.borrow_mut();
        device.tainted = true;
        device.read.hang();
        device.write.hang();
    }

    /// Records misuse again, after faults have ended.
    pub fn forgive(&self) {
        self.0.borrow_mut().tainted = false;
    }

    /// Changes the chip's timing.
    pub fn set_timing(&self, timing: Timing) {
        self.0.borrow_mut().timing = timing;
    }

    /// The traffic since the last call.
    pub fn take_traffic(&self) -> Traffic {
        std::mem::take(&mut self.0.borrow_mut().traffic)
    }

    /// Number of faults injected on the SPI.
    pub fn faults_injected(&self) -> u64 {
        self.0.borrow().injected
    }

    /// The driver's misuses of the chip.
    pub fn violations(&self) -> Vec<String> {
        self.0.borrow().violations.clone()
    }

    /// Fails the test if the driver misused the chip.
    ///
    /// # Panics
    /// If it did.
    #[track_caller]
    pub fn check(&self) {
        let violations = self.violations();
        assert!(violations.is_empty(), "the driver misused the chip: {violations:#?}");
    }
}

/// A LAN9252 driver in front of `chip`, and its interrupt.
pub fn over_spi(chip: SharedChip) -> (Driver<Spi>, Interrupt) {
    let lan9252 = Lan9252::new(chip, Timing::USUAL);
    (Driver::new(lan9252.spi(), Wiring::default()), lan9252.interrupt())
}
