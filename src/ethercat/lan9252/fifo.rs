//! The engines that move process data through FIFOs of sixteen double words.
//!
//! A transfer is streamed through its FIFO in one transaction, however long it is: at 30 MHz a double word takes a microsecond on the SPI, longer
//! than the engine needs for it. That the engine kept up is proved afterwards: had it not, it would still have something to
//! move. From then on the FIFO's
//! level is watched.

use embedded_hal_async::spi::SpiDevice;

use super::Lan9252;
use super::registers::{BUSY, POLLS_MAX};
use crate::ethercat::esc::EscError;

const ABORT: u32 = 1 << 30;
/// So many double words of a transfer must wait in the FIFO before it is streamed.
const LEAD_WORDS: usize = 4;

/// One of the two engines.
#[derive(Debug, Clone, Copy)]
pub(super) struct Direction {
    /// Where its FIFO is.
    port: u16,
    /// Its address and length register; the command register is right behind.
    place: u16,
    /// A transfer is under way: its future was dropped, or it failed.
    open: bool,
    /// Whether the level of the FIFO must be watched.
    watched: bool,
}

impl Direction {
    pub(super) const READ: Self = Self { port: 0x000, place: 0x308, open: false, watched: false };
    pub(super) const WRITE: Self = Self { port: 0x020, place: 0x310, open: false, watched: false };

    /// The engine after an abort.
    pub(super) fn closed(self) -> Self {
        Self { open: false, ..self }
    }

    fn command(self) -> u16 {
        self.place + 4
    }
}

/// Double words that wait, or for which there is room, in a command register.
fn count(status: u32) -> usize {
    (status >> 8 & 0x1F) as usize
}

/// How many of `left` bytes fit into `words` double words when the first lies in byte lane `lane`.
fn fitting(words: usize, lane: usize, left: usize) -> usize {
    (words * 4).saturating_sub(lane).min(left)
}

impl<SPI: SpiDevice> Lan9252<SPI> {
    /// Reads process data memory.
    pub(super) async fn read_memory(&mut self, address: u16, mut into: &mut [u8]) -> Result<(), EscError> {
        if into.is_empty() {
            return Ok(());
        }
        let length = into.len();
        let before = self.reading;
        // Open until the end is proved, also if this future is dropped.
        self.reading.open = true;
        self.begin(before, address, length).await?;
        let mut lane = usize::from(address % 4);
        while !into.is_empty() {
            let left = (lane + into.len()).div_ceil(4);
            let waiting = self.level(self.reading, address, left.min(LEAD_WORDS)).await?;
            let words = if self.reading.watched { waiting } else { left };
            let (part, rest) = into.split_at_mut(fitting(words, lane, into.len()));
            self.bus.read_bytes(self.reading.port, lane, part).await?;
            (into, lane) = (rest, 0);
        }
        let done = self.finish(self.reading, address, length).await;
        self.reading = self.reading.after(done);
        done
    }

    /// Writes process data memory.
    pub(super) async fn write_memory(&mut self, address: u16, mut bytes: &[u8]) -> Result<(), EscError> {
        if bytes.is_empty() {
            return Ok(());
        }
        let length = bytes.len();
        let before = self.writing;
        self.writing.open = true;
        self.begin(before, address, length).await?;
        let mut lane = usize::from(address % 4);
        while !bytes.is_empty() {
            let left = (lane + bytes.len()).div_ceil(4);
            // A FIFO that has just been started is empty: only its watched rest needs a look.
            let words = if self.writing.watched { self.level(self.writing, address, 1).await? } else { left };
            let (part, rest) = bytes.split_at(fitting(words, lane, bytes.len()));
            self.bus.write_bytes(self.writing.port, lane, part).await?;
            (bytes, lane) = (rest, 0);
        }
        let done = self.finish(self.writing, address, length).await;
        self.writing = self.writing.after(done);
        done
    }

    /// Starts a transfer, after ending one that was left.
    async fn begin(&mut self, direction: Direction, address: u16, length: usize) -> Result<(), EscError> {
        if direction.open {
            self.abort(direction).await?;
        }
        self.bus.write_up(direction.place, place(address, length), BUSY).await
    }

    /// Ends whatever transfer an engine has under way.
    pub(super) async fn abort(&mut self, direction: Direction) -> Result<(), EscError> {
        self.bus.write(direction.command(), ABORT).await?;
        for _ in 0..POLLS_MAX {
            if self.bus.read(direction.command()).await? & (BUSY | ABORT) == 0 {
                return Ok(());
            }
        }
        Err(EscError::Stuck(direction.command()))
    }

    /// Waits until at least `wanted` double words wait, or have room; how many it is.
    async fn level(&mut self, direction: Direction, address: u16, wanted: usize) -> Result<usize, EscError> {
        for _ in 0..POLLS_MAX {
            let level = count(self.bus.read(direction.command()).await?);
            if level >= wanted {
                return Ok(level);
            }
        }
        Err(EscError::Stuck(address))
    }

    /// Proves that a transfer was the one that was meant, and that all of it was moved. Address and length count on while
    /// an engine works, or stay as they were written.
    async fn finish(&mut self, direction: Direction, address: u16, length: usize) -> Result<(), EscError> {
        let end = place(address.wrapping_add(length as u16), 0);
        let reads = direction.port == Direction::READ.port;
        for _ in 0..POLLS_MAX {
            let (now, status) = self.bus.read_up(direction.place).await?;
            if status & BUSY != 0 {
                continue;
            }
            let as_meant = now == end || now == place(address, length);
            let left_over = reads && count(status) > 0;
            return if as_meant && !left_over { Ok(()) } else { Err(EscError::Garbled(address)) };
        }
        Err(EscError::Stuck(address))
    }
}

impl Direction {
    /// The engine after a transfer that ended so.
    fn after(self, done: Result<(), EscError>) -> Self {
        match done {
            Ok(()) => self.closed(),
            Err(_) => Self { open: true, watched: true, ..self },
        }
    }
}

/// What goes into the address and length register.
fn place(address: u16, length: usize) -> u32 {
    (length as u32) << 16 | u32::from(address)
}
