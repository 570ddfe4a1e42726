//! The processor's side of a chip (I, PDI): accesses, and the interrupt line.

use std::convert::Infallible;
use std::future::poll_fn;
use std::task::Poll;

use embassy_futures::select::select;
use embassy_time::{Instant, Timer};
use embedded_hal::digital::ErrorType;
use embedded_hal_async::digital::Wait;
use ethercat_subdevice::esc::{Esc, EscError};

use crate::chip::SharedChip;
use crate::dc::sync::SyncLine;
use crate::registers::AL_EVENT;
use crate::{Nanos, now};

/// Direct access to a chip's registers and memory, without a bus; an access takes no time.
pub struct DirectPdi(SharedChip);

impl DirectPdi {
    /// Access to `chip`.
    pub fn new(chip: SharedChip) -> Self {
        Self(chip)
    }
}

impl Esc for DirectPdi {
    async fn read(&mut self, address: u16, into: &mut [u8]) -> Result<(), EscError> {
        self.0.borrow_mut().read(now(), address, into);
        Ok(())
    }

    async fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), EscError> {
        self.0.borrow_mut().write(now(), address, bytes);
        Ok(())
    }

    async fn events(&mut self) -> Result<u32, EscError> {
        let mut events = [0; 4];
        self.read(AL_EVENT, &mut events).await?;
        Ok(u32::from_le_bytes(events))
    }
}

/// An interrupt line (I, Interrupts, "AL event request"). The chip's own line is high while an unmasked AL event is requested.
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

    /// A line with this level, which changes only with `chip`.
    pub fn with_level(chip: SharedChip, level: impl FnMut(Nanos) -> bool + 'static) -> Self {
        Self { chip, level: Box::new(level) }
    }

    /// The same line inverted, for active-low inputs.
    #[must_use]
    pub fn inverted(self) -> Self {
        let mut level = self.level;
        Self { level: Box::new(move |at| !level(at)), ..self }
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

/// The pin of a SYNC signal (I, Distributed Clocks, "SyncSignals generation"), at a processor that notes each edge.
pub struct SyncPin {
    chip: SharedChip,
    line: SyncLine,
    seen: u64,
}

impl SyncPin {
    /// The pin of `line`.
    pub fn new(chip: SharedChip, line: SyncLine) -> Self {
        Self { chip, line, seen: 0 }
    }

    /// Waits for the next pulse, and returns when it began. Pulses in between are left out.
    pub async fn pulse(&mut self) -> Nanos {
        loop {
            self.chip.borrow_mut().advance(now());
            let pulses = self.chip.borrow().pulses_at_pin(self.line);
            if let Some((count, at)) = pulses.filter(|(count, _)| *count != self.seen) {
                self.seen = count;
                return at;
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

/// Waits for a chip time; `None` waits forever.
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
