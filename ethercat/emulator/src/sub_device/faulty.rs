//! Bus faults between processor and chip, as the driver reports them; and access counters.

use std::cell::{Cell, RefCell};
use std::ops::RangeInclusive;
use std::rc::Rc;

use embassy_time::Timer;
use ethercat_subdevice::esc::{Esc, EscError};

use mobgate_world::random::Random;

/// Probabilities of access faults.
#[derive(Debug, Clone)]
pub struct BusFaults {
    /// The bus fails, before or after the access.
    pub failing: f64,
    /// The chip is busy beyond the timeout.
    pub stuck: f64,
    /// The access is delayed.
    pub slow: f64,
    /// The delay in microseconds.
    pub slow_us: RangeInclusive<u64>,
}

impl BusFaults {
    /// No faults.
    pub const NONE: Self = Self { failing: 0.0, stuck: 0.0, slow: 0.0, slow_us: 0..=0 };
}

/// Busy time of a chip until a driver gives up.
const STUCK_MILLIS: u64 = 2;

/// Access to a chip with occasional faults. A bus error may come before or after the access takes effect.
pub struct Faulty<E> {
    esc: E,
    faults: Rc<RefCell<BusFaults>>,
    random: Random,
}

impl<E> Faulty<E> {
    /// Access by `esc` with `faults` drawn from `random`.
    pub fn new(esc: E, faults: Rc<RefCell<BusFaults>>, random: Random) -> Self {
        Self { esc, faults, random }
    }

    async fn before(&mut self, address: u16) -> Result<(), EscError> {
        let faults = self.faults.borrow().clone();
        if self.random.chance(faults.slow) {
            Timer::after_micros(self.random.within(faults.slow_us)).await;
        }
        if self.random.chance(faults.stuck) {
            Timer::after_millis(STUCK_MILLIS).await;
            return Err(EscError::Stuck(address));
        }
        self.bus()
    }

    fn bus(&mut self) -> Result<(), EscError> {
        let failing = self.faults.borrow().failing;
        if self.random.chance(failing / 2.0) { Err(EscError::Bus) } else { Ok(()) }
    }
}

impl<E: Esc> Esc for Faulty<E> {
    async fn read(&mut self, address: u16, into: &mut [u8]) -> Result<(), EscError> {
        self.before(address).await?;
        self.esc.read(address, into).await?;
        self.bus()
    }

    async fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), EscError> {
        self.before(address).await?;
        self.esc.write(address, bytes).await?;
        self.bus()
    }

    async fn events(&mut self) -> Result<u32, EscError> {
        self.before(0x0220).await?;
        let events = self.esc.events().await?;
        self.bus().map(|()| events)
    }
}

/// Access counters.
#[derive(Debug, Default)]
pub struct Counts {
    /// Reads of the event register.
    pub events: Cell<u64>,
    /// Reads that start at the watched address.
    pub watched: Cell<u64>,
}

/// Counted access to a chip.
pub struct Counted<E> {
    esc: E,
    watched: u16,
    counts: Rc<Counts>,
}

impl<E> Counted<E> {
    /// Access by `esc`, watching `address`.
    pub fn new(esc: E, address: u16) -> Self {
        Self { esc, watched: address, counts: Rc::default() }
    }

    /// The shared counters.
    pub fn counts(&self) -> Rc<Counts> {
        self.counts.clone()
    }
}

fn count(cell: &Cell<u64>) {
    cell.set(cell.get() + 1);
}

impl<E: Esc> Esc for Counted<E> {
    async fn read(&mut self, address: u16, into: &mut [u8]) -> Result<(), EscError> {
        if address == self.watched {
            count(&self.counts.watched);
        }
        self.esc.read(address, into).await
    }

    async fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), EscError> {
        self.esc.write(address, bytes).await
    }

    async fn events(&mut self) -> Result<u32, EscError> {
        count(&self.counts.events);
        self.esc.events().await
    }
}
