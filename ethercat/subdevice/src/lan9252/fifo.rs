//! The engines that move process data through FIFOs of sixteen double words.
//!
//! A transfer of any length streams through its FIFO in one transaction if the engine has proved that it keeps up with the SPI: at
//! 30 MHz a double word takes a microsecond. It proves that after each reset, before the memory is in use. Otherwise the FIFO's
//! level is polled. Every transfer ends with a completion check: an engine that had not kept up would still be busy, and from then
//! on it would be polled.

use embedded_hal_async::spi::SpiDevice;

use super::bus::STREAM_BYTES;
use super::direction::Direction;
use super::registers::{BUSY, COMMAND, DATA, POLLS_MAX, READ, command};
use super::{AL_EVENT, Lan9252, PROCESS_RAM};
use crate::esc::EscError;

const ABORT: u32 = 1 << 30;
/// Successive timeouts until the chip is reset.
const STUCK_MAX: u8 = 2;

/// Number of filled or free double words in a command register.
fn count(status: u32) -> usize {
    (status >> 8 & 0x1F) as usize
}

/// How many of `left` bytes fit into `words` double words if the first is in byte lane `lane`.
fn fitting(words: usize, lane: usize, left: usize) -> usize {
    (words * 4).saturating_sub(lane).min(left)
}

impl<SPI: SpiDevice> Lan9252<SPI> {
    /// Reads process data memory.
    pub(super) async fn read_memory(&mut self, address: u16, into: &mut [u8]) -> Result<(), EscError> {
        if into.is_empty() {
            return Ok(());
        }
        let left_open = core::mem::replace(&mut self.reading.open, true);
        let done = self.fetch(left_open, address, into).await;
        self.reading.ended(done);
        done
    }

    /// Writes process data memory.
    pub(super) async fn write_memory(&mut self, address: u16, bytes: &[u8]) -> Result<(), EscError> {
        if bytes.is_empty() {
            return Ok(());
        }
        let left_open = core::mem::replace(&mut self.writing.open, true);
        let done = self.push(left_open, address, bytes).await;
        self.writing.ended(done);
        done
    }

    async fn fetch(&mut self, left_open: bool, address: u16, mut into: &mut [u8]) -> Result<(), EscError> {
        let engine = self.reading;
        let length = into.len();
        self.begin(engine, left_open, address, length).await?;
        let mut lane = usize::from(address % 4);
        while !into.is_empty() {
            let left = (lane + into.len()).div_ceil(4);
            let words = if engine.watched { self.level(engine, address, 1).await? } else { left };
            let (part, rest) = into.split_at_mut(fitting(words, lane, into.len()));
            self.bus.read_bytes(engine.port, lane, part).await?;
            (into, lane) = (rest, 0);
        }
        self.finish(engine, address, length).await
    }

    async fn push(&mut self, left_open: bool, address: u16, mut bytes: &[u8]) -> Result<(), EscError> {
        let engine = self.writing;
        let length = bytes.len();
        self.begin(engine, left_open, address, length).await?;
        let mut lane = usize::from(address % 4);
        while !bytes.is_empty() {
            let left = (lane + bytes.len()).div_ceil(4);
            let words = if engine.watched { self.level(engine, address, 1).await? } else { left };
            let (part, rest) = bytes.split_at(fitting(words, lane, bytes.len()));
            self.bus.write_bytes(engine.port, lane, part).await?;
            (bytes, lane) = (rest, 0);
        }
        self.finish(engine, address, length).await
    }

    /// Streams dummy data in both directions to find out whether the engines keep up. For a chip just reset.
    pub(super) async fn try_engines(&mut self) -> Result<(), EscError> {
        self.reading.watched = !self.keeps_up(Direction::READ).await?;
        self.writing.watched = !self.keeps_up(Direction::WRITE).await?;
        Ok(())
    }

    async fn keeps_up(&mut self, engine: Direction) -> Result<bool, EscError> {
        self.begin(engine, false, PROCESS_RAM, STREAM_BYTES).await?;
        self.bus.stream(engine.reads(), engine.port).await?;
        match self.finish(engine, PROCESS_RAM, STREAM_BYTES).await {
            Ok(()) => Ok(true),
            Err(EscError::Bus) => Err(EscError::Bus),
            Err(_) => self.abort(engine).await.map(|()| false),
        }
    }

    /// Reads the AL events and then process data memory. `None` if a read-back is wrong; the data may be lost then.
    pub(super) async fn read_with_events(
        &mut self,
        address: u16,
        into: &mut [u8],
    ) -> Result<Option<u32>, EscError> {
        let engine = self.reading;
        let command = command(AL_EVENT, 4, READ);
        (self.register_open, self.reading.open) = (true, true);
        // The register engine completes four bytes before the SPI has transferred the other engine's command.
        self.bus.write_three(COMMAND, [command, place(address, into.len()), BUSY]).await?;
        self.bus.read_bytes(engine.port, usize::from(address % 4), into).await?;
        for _ in 0..POLLS_MAX {
            let [events, done, now, status] = self.bus.read_four(DATA).await?;
            if (done | status) & BUSY != 0 {
                continue;
            }
            self.register_open = false;
            let moved = engine.has_moved(now, status, address, into.len());
            self.reading.open = !moved;
            let sure = moved && done == command & !BUSY && self.bus.read(DATA).await? == events;
            return Ok(sure.then_some(events));
        }
        Ok(None)
    }

    /// Whether that is possible: both engines are idle, and the read engine keeps up.
    pub(super) fn can_read_with_events(&self, address: u16, bytes: usize) -> bool {
        let idle = !self.register_open && !self.reading.open;
        idle && !self.reading.watched && address >= PROCESS_RAM && bytes > 0
    }

    /// Starts a transfer, after aborting an unfinished one.
    async fn begin(
        &mut self,
        engine: Direction,
        left_open: bool,
        address: u16,
        length: usize,
    ) -> Result<(), EscError> {
        if left_open {
            self.abort(engine).await?;
        }
        self.bus.write_up(engine.place, place(address, length), BUSY).await
    }

    /// Aborts any transfer of an engine.
    pub(super) async fn abort(&mut self, engine: Direction) -> Result<(), EscError> {
        self.bus.write(engine.command(), ABORT).await?;
        for _ in 0..POLLS_MAX {
            if self.bus.read(engine.command()).await? & (BUSY | ABORT) == 0 {
                return Ok(());
            }
        }
        Err(EscError::Stuck(engine.command()))
    }

    /// Waits until at least `wanted` double words are filled or free; returns how many.
    async fn level(&mut self, engine: Direction, address: u16, wanted: usize) -> Result<usize, EscError> {
        for _ in 0..POLLS_MAX {
            let level = count(self.bus.read(engine.command()).await?);
            if level >= wanted {
                return Ok(level);
            }
        }
        Err(EscError::Stuck(address))
    }

    /// Verifies that the intended transfer took place completely. Address and length either advance while an engine works, or stay
    /// as written.
    async fn finish(&mut self, engine: Direction, address: u16, length: usize) -> Result<(), EscError> {
        for _ in 0..POLLS_MAX {
            let (now, status) = self.bus.read_up(engine.place).await?;
            if status & BUSY != 0 {
                continue;
            }
            let moved = engine.has_moved(now, status, address, length);
            return if moved { Ok(()) } else { Err(EscError::Garbled(address)) };
        }
        Err(EscError::Stuck(address))
    }
}

impl Direction {
    fn reads(self) -> bool {
        self.port == Self::READ.port
    }

    /// Whether the registers of an idle engine show that it completed the intended transfer.
    fn has_moved(self, now: u32, status: u32, address: u16, length: usize) -> bool {
        let end = place(address.wrapping_add(length as u16), 0);
        let left_over = self.reads() && count(status) > 0;
        (now == end || now == place(address, length)) && !left_over
    }

    /// Records the outcome of a transfer. An unverified one is aborted before the next.
    fn ended(&mut self, done: Result<(), EscError>) {
        match done {
            Ok(()) => (self.open, self.stuck) = (false, 0),
            Err(EscError::Stuck(_)) => (self.stuck, self.watched) = (self.stuck.saturating_add(1), true),
            Err(EscError::Garbled(_)) => self.watched = true,
            Err(_) => {}
        }
    }

    /// Whether the engine needs a reset rather than an abort.
    pub(super) fn hangs(self) -> bool {
        self.stuck >= STUCK_MAX
    }

    /// Records that the engine was aborted.
    pub(super) fn aborted(&mut self) {
        self.open = false;
    }

    /// Records that the engine was reset.
    pub(super) fn reset(&mut self) {
        (self.open, self.stuck) = (false, 0);
    }
}

/// The value of the address and length register.
fn place(address: u16, length: usize) -> u32 {
    (length as u32) << 16 | u32::from(address)
}
