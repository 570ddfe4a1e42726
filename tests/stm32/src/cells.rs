//! The flash's memory cells: what they hold is there after a power cut, also one in the middle of an operation.

use std::collections::BTreeSet;
use std::ops::Range;

use crate::chip::{FLASH, FLASH_BYTES, Family};

pub(crate) struct Cells {
    bytes: Vec<u8>,
    /// Words with error correction that were half written, by their addresses.
    torn: BTreeSet<u32>,
    /// The F7's option nDBANK: one bank, as it is delivered.
    pub(crate) is_one_bank: bool,
    /// Programmings and erasures since the beginning.
    pub(crate) operations: usize,
    /// The operation in the middle of which the power is cut.
    pub(crate) cut_at: Option<usize>,
    /// The power was cut.
    pub(crate) is_cut: bool,
    /// What the program did against the rules.
    pub(crate) broken_rule: Option<String>,
    /// Addresses of what has changed since this was last taken.
    pub(crate) changed: Option<Range<u32>>,
}

impl Cells {
    /// Erased cells.
    pub(crate) fn new() -> Self {
        Self {
            bytes: vec![0xff; FLASH_BYTES as usize],
            torn: BTreeSet::new(),
            is_one_bank: true,
            operations: 0,
            cut_at: None,
            is_cut: false,
            broken_rule: None,
            changed: None,
        }
    }

    /// What a programmer, or another program, has left at `address`.
    pub(crate) fn put(&mut self, address: u32, bytes: &[u8]) {
        let at = (address - FLASH) as usize;
        self.bytes[at..at + bytes.len()].copy_from_slice(bytes);
    }

    pub(crate) fn read(&self, address: u32, count: usize) -> &[u8] {
        let at = (address - FLASH) as usize;
        &self.bytes[at..at + count]
    }

    /// Whether a word there has more wrong bits than can be corrected.
    pub(crate) fn is_torn_within(&self, place: Range<u32>) -> bool {
        self.torn.range(place).next().is_some()
    }

    /// Counts an operation; whether the power is cut in the middle of it.
    fn begin(&mut self, address: u32, bytes: u32) -> bool {
        self.changed = Some(address..address + bytes);
        let cut = self.cut_at == Some(self.operations);
        self.operations += 1;
        self.is_cut |= cut;
        cut
    }

    /// Programs `data`, bits of which can only become zeros. `has_ecc`: once only, since its check bits are programmed too.
    pub(crate) fn program(&mut self, address: u32, data: &[u8], has_ecc: bool) {
        let cut = self.begin(address, data.len() as u32);
        let at = (address - FLASH) as usize;
        let cells = &mut self.bytes[at..at + data.len()];
        let is_erased = cells.iter().all(|&byte| byte == 0xff);
        if has_ecc && (!is_erased || self.torn.contains(&address)) {
            self.broken_rule = Some(format!("the flash word at {address:#010x} is programmed a second time"));
        } else if cells.iter().zip(data).any(|(&old, &new)| new & !old != 0) {
            self.broken_rule = Some(format!("the flash at {address:#010x} is programmed without an erase"));
        }
        // Cut off, every other bit that was to become zero has.
        let done = if cut { 0x55 } else { 0xff };
        cells.iter_mut().zip(data).for_each(|(old, &new)| *old &= new | !done);
        if cut && has_ecc {
            self.torn.insert(address);
        }
    }

    /// Erases the sector there. Cut off, half of its words are erased, and with error correction none of the others
    /// can be read.
    pub(crate) fn erase(&mut self, place: Range<u32>, has_ecc: bool) {
        const WORD_BYTES: usize = 32;
        let address = place.start;
        let cut = self.begin(address, place.len() as u32);
        if address == FLASH {
            self.broken_rule = Some("the boot loader is erased".to_owned());
        }
        let at = (address - FLASH) as usize;
        let sector = &mut self.bytes[at..at + place.len()];
        let words = sector.chunks_mut(WORD_BYTES).zip((address..).step_by(WORD_BYTES));
        for (nth, (word, address)) in words.enumerate() {
            if !cut || nth % 2 == 0 {
                word.fill(0xff);
                self.torn.remove(&address);
            } else if has_ecc {
                word.iter_mut().for_each(|byte| *byte |= 0x55);
                self.torn.insert(address);
            }
        }
    }
}

/// The sectors of a family's flash.
pub(crate) fn sectors(family: Family) -> Vec<Range<u32>> {
    const KIB: u32 = 1024;
    let lengths = match family {
        // Two banks (RM0090, table 6).
        Family::F4 => [[16, 16, 16, 16, 64, 128, 128, 128, 128, 128, 128, 128]; 2].concat(),
        // One bank (RM0410, table 3).
        Family::F7 => vec![32, 32, 32, 32, 128, 256, 256, 256, 256, 256, 256, 256],
        // Two banks of eight (RM0433, table 13).
        Family::H7 => vec![128; 16],
    };
    let mut next = FLASH;
    let sector = |length: u32| {
        let start = next;
        next += length * KIB;
        start..next
    };
    lengths.into_iter().map(sector).collect()
}
