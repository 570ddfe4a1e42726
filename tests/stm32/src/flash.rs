//! The flash's interface of the F4 and F7 (RM0090, 3; RM0410, 3), and of the H7 (RM0433, 4).

use std::ops::Range;

use crate::bank::{ALL, Bank, bits};
use crate::cells::{Cells, sectors};
use crate::chip::{Board, FLASH, FLASH_BYTES, Family};
use crate::time::{MICROSECOND, Time};

const KEYS: [u32; 2] = [0x4567_0123, 0xcdef_89ab];
/// Bytes of a word that the H7 programs at a time.
const WORD_BYTES: usize = 32;

/// What an access to the cells asks of the processor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Access {
    /// It goes on.
    Done,
    /// It stands still until then.
    Stall(Time),
}

/// A register of a controller.
#[derive(Clone, Copy)]
enum Register {
    Keys,
    Control,
    Status,
    Clear,
}

/// What one set of registers controls: a bank of the H7, or all of the flash.
struct Controller {
    locked: bool,
    next_key: usize,
    /// A word of the H7 that is being put together: its address, its bytes and which of them are there.
    word: Option<(u32, [u8; WORD_BYTES], u32)>,
}

/// The interface to the cells.
pub(crate) struct Flash {
    family: Family,
    registers: Bank,
    pub(crate) cells: Cells,
    sectors: Vec<Range<u32>>,
    controllers: [Controller; 2],
    /// Until when each bank is busy. The program runs from the first.
    busy_until: [Option<Time>; 2],
}

impl Flash {
    pub(crate) fn new(board: &Board, cells: Cells) -> Self {
        let rows = if board.family == Family::H7 {
            let mut rows: Vec<_> = [0, 8, 0x18, 0x1c, 0x100, 0x108, 0x118].map(|at| (at, 0, ALL)).to_vec();
            for bank in [0, 0x100] {
                rows.extend([
                    (bank + 4, 0, 0),
                    (bank + 0xc, 1, ALL),
                    (bank + 0x10, 0, 0),
                    (bank + 0x14, 0, 0),
                ]);
            }
            rows
        } else {
            let one_bank = if cells.is_one_bank { 1 << 29 } else { 0 };
            vec![
                (0, 0, ALL),
                (8, 0, 0),
                (0xc, 0, 0),
                (0x10, 1 << 31, ALL),
                (0x14, 0x0fff_aaed | one_bank, ALL),
                (0x18, 0, ALL),
            ]
        };
        Self {
            family: board.family,
            registers: Bank::new(&rows),
            cells,
            sectors: sectors(board.family),
            controllers: [0; 2].map(|next_key| Controller { locked: true, next_key, word: None }),
            busy_until: [None; 2],
        }
    }

    fn is_h7(&self) -> bool {
        self.family == Family::H7
    }

    /// The bank that `address` is in.
    fn bank(&self, address: u32) -> usize {
        usize::from(self.family != Family::F7 && address >= FLASH + FLASH_BYTES / 2)
    }

    /// The controller for `address`.
    fn controller(&self, address: u32) -> usize {
        if self.is_h7() { self.bank(address) } else { 0 }
    }

    /// The register at `offset`, and its controller.
    fn register(&self, offset: u32) -> Option<(usize, Register)> {
        let nth = (offset >> 8) as usize;
        match (offset & 0xff, self.is_h7()) {
            _ if nth > usize::from(self.is_h7()) => None,
            (4, _) => Some((nth, Register::Keys)),
            (0xc, true) | (0x10, false) => Some((nth, Register::Control)),
            (0x10, true) | (0xc, false) => Some((nth, Register::Status)),
            (0x14, true) => Some((nth, Register::Clear)),
            _ => None,
        }
    }

    /// Offsets of a controller's control and status.
    fn control(&self, nth: usize) -> u32 {
        if self.is_h7() { 0xc + 0x100 * nth as u32 } else { 0x10 }
    }

    fn status(&self, nth: usize) -> u32 {
        if self.is_h7() { 0x10 + 0x100 * nth as u32 } else { 0xc }
    }

    fn flag(&mut self, nth: usize, flags: u32) {
        self.registers.set(self.status(nth), self.registers.get(self.status(nth)) | flags);
    }

    /// Whether the F4's caches at the flash are on: of instructions, with the prefetch, and of data.
    pub(crate) fn caches(&self) -> (bool, bool) {
        let control = self.registers.get(0);
        (bits(control, 8, 2) == 3, bits(control, 10, 1) != 0)
    }

    /// Whether a controller is busy.
    fn is_busy(&self, nth: usize) -> bool {
        if self.is_h7() {
            self.busy_until[nth].is_some()
        } else {
            self.busy_until.iter().any(Option::is_some)
        }
    }

    /// Whether the register at `offset` says now that an operation goes on.
    pub(crate) fn shows_busy(&self, offset: u32) -> bool {
        matches!(self.register(offset), Some((nth, Register::Status)) if self.is_busy(nth))
    }

    pub(crate) fn read(&self, offset: u32) -> Option<u32> {
        let value = self.registers.read(offset)?;
        Some(match self.register(offset) {
            Some((nth, Register::Status)) => {
                let busy = if self.is_h7() { 5 } else { 1 << 16 };
                let partly = if self.controllers[nth].word.is_some() { 2 } else { 0 };
                value | if self.is_busy(nth) { busy } else { 0 } | partly
            }
            Some((nth, Register::Control)) => {
                let lock = if self.is_h7() { 1 } else { 1 << 31 };
                value & !lock | if self.controllers[nth].locked { lock } else { 0 }
            }
            _ => value,
        })
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32, now: Time) -> Option<()> {
        let Some((nth, register)) = self.register(offset) else { return self.registers.write(offset, value) };
        match register {
            Register::Keys => {
                let controller = &mut self.controllers[nth];
                let is_right = value == KEYS[controller.next_key % 2];
                controller.next_key = if is_right { controller.next_key + 1 } else { 0 };
                controller.locked &= controller.next_key != 2;
            }
            Register::Control => {
                let lock = if self.is_h7() { 1 } else { 1 << 31 };
                if !self.controllers[nth].locked {
                    self.registers.set(offset, value);
                    self.start(nth, value, now);
                }
                let controller = &mut self.controllers[nth];
                controller.locked |= value & lock != 0;
                if controller.locked {
                    controller.next_key = 0;
                }
            }
            // CCR clears by ones; the status of the H7 cannot be written.
            Register::Clear => {
                let status = self.status(nth);
                self.registers.set(status, self.registers.get(status) & !(value & 0x07ef_0000));
            }
            Register::Status if self.is_h7() => {}
            Register::Status => self.registers.set(offset, self.registers.get(offset) & !value),
        }
        Some(())
    }

    /// Begins an erasure if `control` says so.
    fn start(&mut self, nth: usize, control: u32, now: Time) {
        let (erase, start, sector) = if self.is_h7() {
            (control & 4 != 0, control & 1 << 7 != 0, bits(control, 8, 3) as usize + 8 * nth)
        } else {
            // Of an F4's second bank, sectors are numbered from 16.
            let number = bits(control, 3, 5) as usize;
            (control & 2 != 0, control & 1 << 16 != 0, number % 16 + 12 * (number / 16))
        };
        if !erase || !start {
            return;
        }
        let Some(sector) = self.sectors.get(sector).cloned() else {
            self.cells.broken_rule = Some(format!("there is no sector {sector}"));
            return;
        };
        let bank = self.bank(sector.start);
        // As the data sheets say it is usual.
        let milliseconds = match sector.len() >> 10 {
            ..=32 => 250,
            33..=64 => 550,
            65..=128 => 1_000,
            _ => 2_000,
        };
        self.cells.erase(sector, self.is_h7());
        self.busy_until[bank] = Some(now + milliseconds * 1_000 * MICROSECOND);
    }

    /// The program reads a word of the cells. None: error correction refuses.
    pub(crate) fn read_cells(&mut self, address: u32, bytes: usize) -> Option<u64> {
        let word = address - address % WORD_BYTES as u32;
        if self.cells.is_torn_within(word..word + 1) {
            self.flag(self.controller(address), 1 << 26);
            return None;
        }
        let bytes = self.cells.read(address, bytes);
        Some(bytes.iter().rev().fold(0, |word, &byte| word << 8 | u64::from(byte)))
    }

    /// The program writes into the cells.
    pub(crate) fn write_cells(&mut self, address: u32, bytes: usize, value: u64, now: Time) {
        let nth = self.controller(address);
        let control = self.registers.get(self.control(nth));
        if self.is_h7() {
            return self.fill_word(address, bytes, value, control, now);
        }
        // PGSERR, and PGPERR: as many bits as PSIZE says.
        if self.controllers[nth].locked || control & 1 == 0 {
            return self.flag(nth, 1 << 7);
        }
        if bytes != 1 << bits(control, 8, 2) {
            return self.flag(nth, 1 << 6);
        }
        self.cells.program(address, &value.to_le_bytes()[..bytes], false);
        self.busy_until[self.bank(address)] = Some(now + 16 * MICROSECOND);
    }

    fn fill_word(&mut self, address: u32, bytes: usize, value: u64, control: u32, now: Time) {
        let nth = self.controller(address);
        // PGSERR: PG is not set. INCERR: another word than the one begun.
        if self.controllers[nth].locked || control & 2 == 0 {
            return self.flag(nth, 1 << 18);
        }
        let within = address % WORD_BYTES as u32;
        let (start, mut data, mut there) =
            self.controllers[nth].word.take().unwrap_or((address - within, [0xff; WORD_BYTES], 0));
        if start != address - within {
            return self.flag(nth, 1 << 21);
        }
        let within = within as usize;
        data[within..within + bytes].copy_from_slice(&value.to_le_bytes()[..bytes]);
        there |= ((1 << bytes) - 1) << within;
        if there != u32::MAX {
            self.controllers[nth].word = Some((start, data, there));
            return;
        }
        self.cells.program(start, &data, true);
        self.busy_until[nth] = Some(now + 100 * MICROSECOND);
    }

    /// What the processor does while the flash is busy: it stands still if its own bank is, or the one that it accesses at `address`.
    pub(crate) fn access(&self, address: Option<u32>) -> Access {
        let other = address.map_or(0, |address| self.bank(address));
        match self.busy_until[0].or(self.busy_until[other]) {
            Some(until) => Access::Stall(until),
            None => Access::Done,
        }
    }

    pub(crate) fn next_event(&self) -> Option<Time> {
        self.busy_until.iter().flatten().min().copied()
    }

    pub(crate) fn advance(&mut self, now: Time) {
        for bank in 0..2 {
            if self.busy_until[bank].is_none_or(|at| at > now) {
                continue;
            }
            self.busy_until[bank] = None;
            let nth = if self.is_h7() { bank } else { 0 };
            let control = self.control(nth);
            // STRT goes by itself. EOP of the F4 and F7 comes only with its interrupt.
            let start = if self.is_h7() { 1 << 7 } else { 1 << 16 };
            self.registers.set(control, self.registers.get(control) & !start);
            if self.is_h7() {
                self.flag(nth, 1 << 16);
            } else if self.registers.get(control) >> 24 & 1 != 0 {
                self.flag(nth, 1);
            }
        }
    }

    pub(crate) fn interrupts(&self) -> bool {
        let get = |nth| (self.registers.get(self.control(nth)), self.registers.get(self.status(nth)));
        if self.is_h7() {
            // Each flag's enabling bit has its place.
            return [0, 1].map(get).iter().any(|(control, status)| control & status & 0x007f_0000 != 0);
        }
        let (control, status) = get(0);
        control >> 24 & 1 != 0 && status & 1 != 0 || control >> 25 & 1 != 0 && status & 2 != 0
    }
}
