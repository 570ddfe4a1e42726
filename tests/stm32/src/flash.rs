//! The flash's interface of the F4 and F7 (RM0090, 3; RM0410, 3), and of the H7 (RM0433, 4).

use crate::bank::{ALL, Bank, bits};
use crate::cells::Cells;
use crate::chip::{Board, Family};
use crate::time::{MICROSECOND, SECOND, Time};

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

/// The interface to the cells. Of the H7's two banks it is the second one's that has the settings.
pub(crate) struct Flash {
    family: Family,
    registers: Bank,
    pub(crate) cells: Cells,
    settings: (u32, u32),
    locked: bool,
    next_key: usize,
    busy_until: Option<Time>,
    /// A word of the H7 that is being put together: its address, its bytes and which of them are there.
    word: Option<(u32, [u8; WORD_BYTES], u32)>,
}

impl Flash {
    pub(crate) fn new(board: &Board, cells: Cells) -> Self {
        let rows = if board.family == Family::H7 {
            let mut rows: Vec<_> = [0, 8, 0x18, 0x1c, 0x100, 0x108, 0x118].map(|at| (at, 0, ALL)).to_vec();
            // Of the first bank nothing but the lock is used.
            rows.extend([(4, 0, 0), (0xc, 1, 1), (0x10, 0, 0), (0x14, 0, 0)]);
            rows.extend([(0x10c, 1, ALL), (0x110, 0, 0)]);
            rows
        } else {
            // nDBANK of the F7: one bank, as delivered.
            vec![
                (0, 0, ALL),
                (8, 0, 0),
                (0xc, 0, 0),
                (0x10, 1 << 31, ALL),
                (0x14, 0x2fff_aaed, ALL),
                (0x18, 0, ALL),
            ]
        };
        Self {
            family: board.family,
            registers: Bank::new(&rows),
            cells,
            settings: board.settings,
            locked: true,
            next_key: 0,
            busy_until: None,
            word: None,
        }
    }

    fn is_h7(&self) -> bool {
        self.family == Family::H7
    }

    /// Offsets of control and status.
    fn control(&self) -> u32 {
        if self.is_h7() { 0x10c } else { 0x10 }
    }

    fn status(&self) -> u32 {
        if self.is_h7() { 0x110 } else { 0xc }
    }

    fn flag(&mut self, flags: u32) {
        self.registers.set(self.status(), self.registers.get(self.status()) | flags);
    }

    pub(crate) fn read(&self, offset: u32) -> Option<u32> {
        if offset == self.status() {
            let busy = if self.is_h7() { 5 } else { 1 << 16 };
            let partly = if self.word.is_some() { 2 } else { 0 };
            let busy = if self.busy_until.is_some() { busy } else { 0 };
            return Some(self.registers.get(offset) | busy | partly);
        }
        if offset == self.control() {
            let lock = if self.is_h7() { 1 } else { 1 << 31 };
            return Some(self.registers.get(offset) & !lock | if self.locked { lock } else { 0 });
        }
        self.registers.read(offset)
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32, now: Time) -> Option<()> {
        let key = if self.is_h7() { 0x104 } else { 4 };
        match offset {
            _ if offset == key => {
                self.next_key = if value == KEYS[self.next_key % 2] { self.next_key + 1 } else { 0 };
                self.locked &= self.next_key != 2;
            }
            _ if offset == self.control() => {
                let lock = if self.is_h7() { 1 } else { 1 << 31 };
                if !self.locked {
                    self.registers.set(offset, value);
                    self.start(value, now);
                }
                self.locked |= value & lock != 0;
                if self.locked {
                    self.next_key = 0;
                }
            }
            // CCR2 clears by ones; the status of the H7 cannot be written.
            0x114 if self.is_h7() => {
                self.registers.set(0x110, self.registers.get(0x110) & !(value & 0x07ef_0000));
            }
            0x110 if self.is_h7() => {}
            0xc if !self.is_h7() => self.registers.set(0xc, self.registers.get(0xc) & !value),
            _ => self.registers.write(offset, value)?,
        }
        Some(())
    }

    /// Begins an erasure if `control` says so.
    fn start(&mut self, control: u32, now: Time) {
        let (erase, start, sector) = if self.is_h7() {
            (control & 4 != 0, control & 1 << 7 != 0, bits(control, 8, 3))
        } else {
            (control & 2 != 0, control & 1 << 16 != 0, bits(control, 3, 5))
        };
        if !erase || !start {
            return;
        }
        let first = match self.family {
            Family::F4 => 0x1a,
            Family::F7 => 10,
            Family::H7 => 6,
        };
        let (base, bytes) = self.settings;
        match sector.checked_sub(first).filter(|&nth| nth < 2) {
            Some(nth) => self.cells.erase(base + nth * bytes, self.is_h7()),
            None => self.cells.broken_rule = Some(format!("sector {sector} of the program is erased")),
        }
        // As the data sheets say it is usual.
        let seconds = if self.family == Family::F7 { 2 } else { 1 };
        self.busy_until = Some(now + seconds * SECOND);
    }

    /// The program reads a word of the cells. None: error correction refuses.
    pub(crate) fn read_cells(&mut self, address: u32, bytes: usize) -> Option<u64> {
        let word = address - (address - self.cells.base()) % WORD_BYTES as u32;
        if self.cells.is_torn(word) {
            self.flag(1 << 26);
            return None;
        }
        let bytes = self.cells.read(address, bytes);
        Some(bytes.iter().rev().fold(0, |word, &byte| word << 8 | u64::from(byte)))
    }

    /// The program writes into the cells.
    pub(crate) fn write_cells(&mut self, address: u32, bytes: usize, value: u64, now: Time) {
        let control = self.registers.get(self.control());
        if self.is_h7() {
            return self.fill_word(address, bytes, value, control, now);
        }
        // PGSERR, and PGPERR: as many bits as PSIZE says.
        if self.locked || control & 1 == 0 {
            return self.flag(1 << 7);
        }
        if bytes != 1 << bits(control, 8, 2) {
            return self.flag(1 << 6);
        }
        self.cells.program(address, &value.to_le_bytes()[..bytes], false);
        self.busy_until = Some(now + 16 * MICROSECOND);
    }

    fn fill_word(&mut self, address: u32, bytes: usize, value: u64, control: u32, now: Time) {
        // PGSERR: PG is not set. INCERR: another word than the one begun.
        if self.locked || control & 2 == 0 {
            return self.flag(1 << 18);
        }
        let within = (address - self.cells.base()) % WORD_BYTES as u32;
        let (start, mut data, mut there) =
            self.word.take().unwrap_or((address - within, [0xff; WORD_BYTES], 0));
        if start != address - within {
            return self.flag(1 << 21);
        }
        let within = within as usize;
        data[within..within + bytes].copy_from_slice(&value.to_le_bytes()[..bytes]);
        there |= ((1 << bytes) - 1) << within;
        if there != u32::MAX {
            self.word = Some((start, data, there));
            return;
        }
        self.cells.program(start, &data, true);
        self.busy_until = Some(now + 100 * MICROSECOND);
    }

    /// What the processor does while the flash is busy: with one bank it stands still, with two only if it `touches` the busy one.
    pub(crate) fn access(&self, touches: bool) -> Access {
        match self.busy_until {
            Some(until) if touches || self.family == Family::F7 => Access::Stall(until),
            _ => Access::Done,
        }
    }

    pub(crate) fn next_event(&self) -> Option<Time> {
        self.busy_until
    }

    pub(crate) fn advance(&mut self, now: Time) {
        if self.busy_until.is_some_and(|at| at <= now) {
            self.busy_until = None;
            let control = self.control();
            // STRT goes by itself. EOP of the F4 and F7 comes only with its interrupt.
            let start = if self.is_h7() { 1 << 7 } else { 1 << 16 };
            self.registers.set(control, self.registers.get(control) & !start);
            if self.is_h7() {
                self.flag(1 << 16);
            } else if self.registers.get(control) >> 24 & 1 != 0 {
                self.flag(1);
            }
        }
    }

    pub(crate) fn interrupts(&self) -> bool {
        let (control, status) = (self.registers.get(self.control()), self.registers.get(self.status()));
        if self.is_h7() {
            // Each flag's enabling bit has its place.
            control & status & 0x007f_0000 != 0
        } else {
            control >> 24 & 1 != 0 && status & 1 != 0 || control >> 25 & 1 != 0 && status & 2 != 0
        }
    }
}
