//! The flash's memory cells of the settings' two sectors: what they hold is there after a power cut, also one in the middle of an
//! operation.

use std::collections::BTreeSet;

/// Cells.
pub(crate) struct Cells {
    /// The address of the first byte.
    base: u32,
    sector_bytes: u32,
    bytes: Vec<u8>,
    /// Words with error correction that were half written, by their addresses.
    torn: BTreeSet<u32>,
    /// Programmings and erasures since the beginning.
    pub(crate) operations: usize,
    /// The operation in the middle of which the power is cut.
    pub(crate) cut_at: Option<usize>,
    /// The power was cut.
    pub(crate) is_cut: bool,
    /// What the program did against the rules.
    pub(crate) broken_rule: Option<String>,
}

impl Cells {
    /// Erased cells.
    pub(crate) fn new((base, sector_bytes): (u32, u32)) -> Self {
        Self {
            base,
            sector_bytes,
            bytes: vec![0xff; 2 * sector_bytes as usize],
            torn: BTreeSet::new(),
            operations: 0,
            cut_at: None,
            is_cut: false,
            broken_rule: None,
        }
    }

    /// As the chip was delivered: nobody has erased these sectors, and something is in them.
    pub(crate) fn fill(&mut self, byte: u8) {
        self.bytes.fill(byte);
    }

    pub(crate) fn base(&self) -> u32 {
        self.base
    }

    pub(crate) fn read(&self, address: u32, count: usize) -> &[u8] {
        let at = (address - self.base) as usize;
        &self.bytes[at..at + count]
    }

    /// Whether a word that begins at `address` has more wrong bits than can be corrected.
    pub(crate) fn is_torn(&self, address: u32) -> bool {
        self.torn.contains(&address)
    }

    /// Counts an operation; whether the power is cut in the middle of it.
    fn begin(&mut self) -> bool {
        let cut = self.cut_at == Some(self.operations);
        self.operations += 1;
        self.is_cut |= cut;
        cut
    }

    /// Programs `data`, bits of which can only become zeros. `has_ecc`: once only, since its check bits are programmed too.
    pub(crate) fn program(&mut self, address: u32, data: &[u8], has_ecc: bool) {
        let cut = self.begin();
        let at = (address - self.base) as usize;
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

    /// Erases the sector that begins at `address`. Cut off, half of its words are erased, and with error correction none of the others
    /// can be read.
    pub(crate) fn erase(&mut self, address: u32, has_ecc: bool) {
        const WORD_BYTES: usize = 32;
        let cut = self.begin();
        let at = (address - self.base) as usize;
        let sector = &mut self.bytes[at..at + self.sector_bytes as usize];
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
