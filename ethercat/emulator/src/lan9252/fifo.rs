//! The engines that move process data between the ESC's memory and a FIFO.

use std::collections::VecDeque;

use crate::registers::PROCESS_RAM;
use crate::{Chip, Nanos};

const BUSY: u32 = 1 << 31;
const ABORT: u32 = 1 << 30;
/// Double words that a FIFO holds.
const DEPTH: usize = 16;
const RAM_END: u32 = 0x2000;
/// The value read from an empty FIFO.
const NOTHING: u32 = 0xDEAD_BEEF;

/// The engine of one direction; address and length advance as it moves data.
#[derive(Debug, Default)]
pub(super) struct Fifo {
    address: u16,
    length: u16,
    started: (u16, u16),
    words: VecDeque<u32>,
    active: bool,
    next: Nanos,
    hangs: bool,
}

impl Fifo {
    pub(super) fn hang(&mut self) {
        self.hangs = true;
    }

    pub(super) fn place(&self) -> u32 {
        u32::from(self.length) << 16 | u32::from(self.address)
    }

    pub(super) fn set_place(&mut self, place: u32) -> Result<(), &'static str> {
        if self.active {
            return Err("address and length changed during a transfer");
        }
        (self.address, self.length) = (place as u16, (place >> 16) as u16);
        Ok(())
    }

    /// The read engine's command register: number of double words to fetch.
    pub(super) fn waiting(&self) -> u32 {
        self.status(self.words.len())
    }

    /// The write engine's command register: number of double words that fit.
    pub(super) fn room(&self) -> u32 {
        self.status(DEPTH - self.words.len())
    }

    fn status(&self, count: usize) -> u32 {
        let busy = if self.active { BUSY } else { 0 };
        busy | (count as u32) << 8 | u32::from(count > 0)
    }

    /// Starts or aborts a transfer. `other` is the other direction's engine.
    pub(super) fn command(&mut self, command: u32, other: &Self, at: Nanos) -> Result<(), &'static str> {
        if command & ABORT != 0 {
            self.words.clear();
            self.active = false;
            return Ok(());
        }
        if command & BUSY == 0 {
            return Ok(());
        }
        let unfinished = self.active || !self.words.is_empty();
        let range = u32::from(self.address)..u32::from(self.address) + u32::from(self.length);
        self.started = (self.address, self.length);
        self.words.clear();
        self.active = self.length > 0;
        self.next = at;
        if unfinished {
            return Err("transfer started in the middle of another, without an abort");
        }
        if range.is_empty() || range.start < u32::from(PROCESS_RAM) || range.end > RAM_END {
            self.active = false;
            return Err("transfer outside of process data memory");
        }
        let others = u32::from(other.started.0)..u32::from(other.started.0) + u32::from(other.started.1);
        if other.active && range.start < others.end && others.start < range.end {
            return Err("both directions at once in the same memory");
        }
        Ok(())
    }

    /// Fills the FIFO from the ESC's memory up to `at`.
    pub(super) fn fill(&mut self, chip: &mut Chip, at: Nanos, takes: Nanos) {
        while self.moves(at) && self.words.len() < DEPTH {
            let (first, count) = self.lanes();
            let mut bytes = [0; 4];
            chip.read(self.next, self.address, &mut bytes[first..first + count]);
            self.words.push_back(u32::from_le_bytes(bytes));
            self.advance(count, takes);
        }
        // A full FIFO stalls the engine.
        if self.words.len() == DEPTH {
            self.next = self.next.max(at);
        }
    }

    /// Empties the FIFO into the ESC's memory up to `at`.
    pub(super) fn drain(&mut self, chip: &mut Chip, at: Nanos, takes: Nanos) {
        while self.moves(at)
            && let Some(word) = self.words.pop_front()
        {
            let (first, count) = self.lanes();
            chip.write(self.next, self.address, &word.to_le_bytes()[first..first + count]);
            self.advance(count, takes);
        }
        if self.words.is_empty() {
            self.next = self.next.max(at);
        }
    }

    /// Empties the FIFO at once. The driver cannot observe that between two transactions.
    pub(super) fn settle(&mut self, chip: &mut Chip) {
        let next = self.next;
        self.drain(chip, Nanos::MAX / 2, 0);
        self.next = next;
    }

    pub(super) fn pop(&mut self) -> Result<u32, &'static str> {
        self.words.pop_front().ok_or("fetched from an empty FIFO")
    }

    pub(super) fn push(&mut self, word: u32) -> Result<(), &'static str> {
        let left = (usize::from(self.address % 4) + usize::from(self.length)).div_ceil(4);
        if !self.active || self.words.len() >= left {
            return Err("more data than the transfer is long");
        }
        if self.words.len() == DEPTH {
            return Err("pushed into a full FIFO");
        }
        self.words.push_back(word);
        Ok(())
    }

    fn moves(&self, at: Nanos) -> bool {
        self.active && !self.hangs && self.next <= at
    }

    /// The first byte lane of the next double word, and how many bytes of it belong to the transfer.
    fn lanes(&self) -> (usize, usize) {
        let first = usize::from(self.address % 4);
        (first, (4 - first).min(usize::from(self.length)))
    }

    fn advance(&mut self, count: usize, takes: Nanos) {
        self.address += count as u16;
        self.length -= count as u16;
        self.active = self.length > 0;
        self.next += takes;
    }
}

/// The value read from an empty FIFO.
pub(super) fn or_nothing(word: Result<u32, &'static str>) -> (u32, Result<(), &'static str>) {
    match word {
        Ok(word) => (word, Ok(())),
        Err(violation) => (NOTHING, Err(violation)),
    }
}
