//! The LAN9252 as its driver sees it: an SPI device in front of the simulated controller chip, and an interrupt pin.
//!
//! A transaction goes byte by byte through `spi`, which decodes the instruction and the address, to the system registers
//! (`device`). Behind some of these are engines that take their time (`csr`, `fifo`): one accesses registers of the ESC, two move
//! process data through FIFOs of sixteen double words. What a careful driver would never do is written down and fails the
//! test that asks ([`Lan9252::check`]).

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
pub use spi::Spi;

/// A handle on the chip: for the test, which sets faults and looks at counters.
#[derive(Clone)]
pub struct Lan9252(Rc<RefCell<Device>>);

impl Lan9252 {
    /// A chip in front of `chip` that has just left its reset.
    pub fn new(chip: SharedChip, timing: Timing) -> Self {
        Self(Rc::new(RefCell::new(Device::new(chip, timing, now()))))
    }

    /// The same, on a board whose resistor at the interrupt pin leads up; else it leads down.
    #[must_use]
    pub fn pulled_up(self) -> Self {
        self.0.borrow_mut().pulled_up = true;
        self
    }

    /// The processor's SPI.
    pub fn spi(&self) -> Spi {
        Spi::new(self.0.clone())
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

    /// From now on `faults` happen as `random` draws them. What they make of a driver's accesses is not held against it.
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

    /// Lets the engine that accesses registers never finish, until the chip is reset.
    pub fn hang_registers(&self) {
        self.0.borrow_mut().csr.hang();
    }

    /// Lets the engines that move process data stand still, until the chip is reset.
    pub fn hang_transfers(&self) {
        let mut device = self.0.borrow_mut();
        device.tainted = true;
        device.read.hang();
        device.write.hang();
    }

    /// From now on the driver's accesses are judged again, after faults that have ended.
    pub fn forgive(&self) {
        self.0.borrow_mut().tainted = false;
    }

    /// Changes how fast the chip is.
    pub fn set_timing(&self, timing: Timing) {
        self.0.borrow_mut().timing = timing;
    }

    /// What was counted since this was last called.
    pub fn take_traffic(&self) -> Traffic {
        std::mem::take(&mut self.0.borrow_mut().traffic)
    }

    /// How often a fault has hit the SPI.
    pub fn faults_injected(&self) -> u64 {
        self.0.borrow().injected
    }

    /// What the driver should not have done.
    pub fn violations(&self) -> Vec<String> {
        self.0.borrow().violations.clone()
    }

    /// Fails the test if the driver did something that it should not have done.
    ///
    /// # Panics
    /// Then.
    #[track_caller]
    pub fn check(&self) {
        let violations = self.violations();
        assert!(violations.is_empty(), "the driver misused the chip: {violations:#?}");
    }
}

/// The driver of a usual chip in front of `chip`, and its interrupt.
pub fn over_spi(chip: SharedChip) -> (Driver<Spi>, Interrupt) {
    let lan9252 = Lan9252::new(chip, Timing::USUAL);
    (Driver::new(lan9252.spi(), Wiring::default()), lan9252.interrupt())
}
