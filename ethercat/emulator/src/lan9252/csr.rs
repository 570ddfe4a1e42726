//! The engine that accesses single ESC registers.

use crate::registers::PROCESS_RAM;
use crate::{Chip, Nanos};

const BUSY: u32 = 1 << 31;
const READ: u32 = 1 << 30;

/// Data and command registers, and when the command completes.
#[derive(Debug, Default)]
pub(super) struct Csr {
    data: u32,
    command: u32,
    done: Nanos,
    /// The next command never completes.
    hangs: bool,
    stuck: bool,
}

impl Csr {
    pub(super) fn hang(&mut self) {
        self.hangs = true;
    }

    fn busy(&self, at: Nanos) -> bool {
        self.stuck || at < self.done
    }

    /// The data register is invalid while the engine is busy.
    pub(super) fn data(&self, at: Nanos) -> u32 {
        if self.busy(at) { !self.data } else { self.data }
    }

    pub(super) fn set_data(&mut self, data: u32, at: Nanos) -> Result<(), &'static str> {
        if self.busy(at) {
            return Err("register data written while the engine is busy");
        }
        self.data = data;
        Ok(())
    }

    pub(super) fn command(&self, at: Nanos) -> u32 {
        self.command & !BUSY | if self.busy(at) { BUSY } else { 0 }
    }

    /// Starts a command that takes `takes`.
    pub(super) fn start(
        &mut self,
        command: u32,
        chip: &mut Chip,
        at: Nanos,
        takes: Nanos,
    ) -> Result<(), &'static str> {
        if self.busy(at) {
            return Err("register command while the engine is busy");
        }
        self.command = command;
        if command & BUSY == 0 {
            return Ok(());
        }
        self.done = at + takes;
        self.stuck = self.hangs;
        let address = command as u16;
        let size = (command >> 16 & 7) as usize;
        let fits = matches!((size, address % 4), (4, 0) | (2, 0 | 2) | (1, _));
        if !fits {
            return Err("register access whose size does not fit its address");
        }
        if address >= PROCESS_RAM {
            return Err("register access to process data memory");
        }
        let mut bytes = self.data.to_le_bytes();
        if command & READ != 0 {
            bytes = [0; 4];
            chip.read(at, address, &mut bytes[..size]);
            self.data = u32::from_le_bytes(bytes);
        } else {
            chip.write(at, address, &bytes[..size]);
        }
        Ok(())
    }
}
