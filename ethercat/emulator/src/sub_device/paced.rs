//! Slow access to a chip: in pieces with pauses, during which frames may arrive.

use std::ops::RangeInclusive;

use embassy_time::Timer;
use ethercat_subdevice::esc::{Esc, EscError};

use crate::registers::PROCESS_RAM;
use mobgate_world::random::Random;

/// Access by `E` with a random pause before every access. Process data memory is accessed in pieces of random length, with a pause
/// before each.
pub struct Paced<E> {
    esc: E,
    random: Random,
    pauses_us: RangeInclusive<u64>,
}

impl<E> Paced<E> {
    /// Access by `esc` with pauses in `pauses_us` drawn from `random`.
    pub fn new(esc: E, random: Random, pauses_us: RangeInclusive<u64>) -> Self {
        Self { esc, random, pauses_us }
    }

    /// Waits, and returns how many of `left` bytes come next.
    async fn piece(&mut self, address: u16, left: usize) -> usize {
        let pause = self.random.within(self.pauses_us.clone());
        let length = if address < PROCESS_RAM { left } else { 1 + self.random.index(left.max(1)) };
        Timer::after_micros(pause).await;
        length.min(left)
    }
}

impl<E: Esc> Esc for Paced<E> {
    async fn read(&mut self, address: u16, into: &mut [u8]) -> Result<(), EscError> {
        let mut done = 0;
        while done < into.len() {
            let from = address + done as u16;
            let length = self.piece(from, into.len() - done).await;
            self.esc.read(from, &mut into[done..done + length]).await?;
            done += length;
        }
        Ok(())
    }

    async fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), EscError> {
        let mut done = 0;
        while done < bytes.len() {
            let from = address + done as u16;
            let length = self.piece(from, bytes.len() - done).await;
            self.esc.write(from, &bytes[done..done + length]).await?;
            done += length;
        }
        Ok(())
    }

    async fn events(&mut self) -> Result<u32, EscError> {
        self.piece(0, 4).await;
        self.esc.events().await
    }
}
