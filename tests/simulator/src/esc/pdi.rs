//! The processor's side of a chip: accesses in virtual time, and the interrupt line.

use std::cell::RefCell;
use std::convert::Infallible;
use std::future::poll_fn;
use std::ops::RangeInclusive;
use std::rc::Rc;
use std::task::Poll;

use embassy_futures::select::select;
use embassy_time::{Instant, Timer};
use embedded_hal::digital::ErrorType;
use embedded_hal_async::digital::Wait;
use mobgate::ethercat::esc::{Esc, EscError};

use super::chip::Chip;
use super::registers::{AL_EVENT, PROCESS_RAM};
use super::{Nanos, now};
use crate::random::Random;

/// A chip that frames and the processor share.
pub type SharedChip = Rc<RefCell<Chip>>;

/// Direct access to a chip's registers and memory, without a bus between.
///
/// An access takes no time, unless it was given a timing: then process data memory is accessed in pieces of random length with
/// random pauses between, in which frames may come.
pub struct DirectPdi {
    chip: SharedChip,
    timing: Option<(Random, RangeInclusive<u64>)>,
    accesses: u64,
}

impl DirectPdi {
    /// Access to `chip` that takes no time.
    pub fn new(chip: SharedChip) -> Self {
        Self { chip, timing: None, accesses: 0 }
    }

    /// The same, with a random pause from `pauses_us` before every access and every piece of one.
    #[must_use]
    pub fn with_pauses(mut self, random: Random, pauses_us: RangeInclusive<u64>) -> Self {
        self.timing = Some((random, pauses_us));
        self
    }

    /// How often the chip was accessed.
    pub fn accesses(&self) -> u64 {
        self.accesses
    }

    /// Waits, and says how many of `left` bytes come next.
    async fn piece(&mut self, address: u16, left: usize) -> usize {
        self.accesses += 1;
        let Some((random, pauses)) = &mut self.timing else { return left };
        let pause = random.within(pauses.clone());
        let length = if address < PROCESS_RAM { left } else { 1 + random.index(left.max(1)) };
        Timer::after_micros(pause).await;
        length.min(left)
    }
}

impl Esc for DirectPdi {
    async fn read(&mut self, address: u16, into: &mut [u8]) -> Result<(), EscError> {
        let mut done = 0;
        while done < into.len() {
            let from = address + done as u16;
            let length = self.piece(from, into.len() - done).await;
            self.chip.borrow_mut().read(now(), from, &mut into[done..done + length]);
            done += length;
        }
        Ok(())
    }

    async fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), EscError> {
        let mut done = 0;
        while done < bytes.len() {
            let from = address + done as u16;
            let length = self.piece(from, bytes.len() - done).await;
            self.chip.borrow_mut().write(now(), from, &bytes[done..done + length]);
            done += length;
        }
        Ok(())
    }

    async fn events(&mut self) -> Result<u32, EscError> {
        let mut events = [0; 4];
        self.read(AL_EVENT, &mut events).await?;
        Ok(u32::from_le_bytes(events))
    }
}

/// An interrupt line: of the chip itself it is high while an event that the AL event mask lets through is requested.
pub struct Interrupt {
    chip: SharedChip,
    level: Box<dyn FnMut(Nanos) -> bool>,
}

impl Interrupt {
    /// The line of `chip`.
    pub fn new(chip: SharedChip) -> Self {
        let line = chip.clone();
        Self::with_level(chip, move |at| line.borrow_mut().interrupt(at))
    }

    /// A line with this level, which changes only when `chip` changes.
    pub fn with_level(chip: SharedChip, level: impl FnMut(Nanos) -> bool + 'static) -> Self {
        Self { chip, level: Box::new(level) }
    }

    async fn wait_for(&mut self, high: bool) {
        loop {
            if (self.level)(now()) == high {
                return;
            }
            let next = self.chip.borrow().next_change(now());
            select(changed(&self.chip), until(next)).await;
        }
    }
}

/// Waits until a frame or an access may have changed `chip`.
pub(crate) async fn changed(chip: &SharedChip) {
    let mut registered = false;
    poll_fn(|context| {
        if std::mem::replace(&mut registered, true) {
            return Poll::Ready(());
        }
        chip.borrow_mut().wake_at_change(context.waker());
        Poll::Pending
    })
    .await;
}

/// Waits for a time of the chip, or for ever.
pub(crate) async fn until(time: Option<Nanos>) {
    match time {
        Some(time) => Timer::at(Instant::from_micros(time.div_ceil(1_000))).await,
        None => std::future::pending().await,
    }
}

impl ErrorType for Interrupt {
    type Error = Infallible;
}

impl Wait for Interrupt {
    async fn wait_for_high(&mut self) -> Result<(), Infallible> {
        self.wait_for(true).await;
        Ok(())
    }

    async fn wait_for_low(&mut self) -> Result<(), Infallible> {
        self.wait_for(false).await;
        Ok(())
    }

    async fn wait_for_rising_edge(&mut self) -> Result<(), Infallible> {
        self.wait_for(false).await;
        self.wait_for(true).await;
        Ok(())
    }

    async fn wait_for_falling_edge(&mut self) -> Result<(), Infallible> {
        self.wait_for(true).await;
        self.wait_for(false).await;
        Ok(())
    }

    async fn wait_for_any_edge(&mut self) -> Result<(), Infallible> {
        let high = (self.level)(now());
        self.wait_for(!high).await;
        Ok(())
    }
}
