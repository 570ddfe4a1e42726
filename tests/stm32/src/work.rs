//! How many instructions were executed, and where.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use crate::chip::FLASH;

/// Bytes from the flash's beginning to the last program's end.
const CODE_BYTES_MAX: usize = 0xc_0000;

/// A block's address and length in bytes.
pub(crate) type Block = (u32, u32);

/// Hashes blocks. The standard library's way, which holds against keys that somebody chose, took a sixth of all tests' time.
#[derive(Default)]
struct Mix(u64);

impl Hasher for Mix {
    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&byte| self.write_u32(byte.into()));
    }

    fn write_u32(&mut self, word: u32) {
        self.0 = (self.0 ^ u64::from(word)).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(26);
    }

    fn finish(&self) -> u64 {
        self.0
    }
}

/// What is known of a block.
#[derive(Clone, Copy, Default)]
struct Counted {
    bytes: u32,
    instructions: u32,
    /// How many of them were executed.
    executed: i64,
}

/// Counts of instructions.
pub(crate) struct Work {
    /// All since the beginning.
    pub(crate) total: u64,
    /// Blocks by the half-words of the flash that they begin at, and those that begin at the same one, or elsewhere.
    blocks: Vec<Counted>,
    others: HashMap<Block, Counted, BuildHasherDefault<Mix>>,
}

impl Default for Work {
    fn default() -> Self {
        Self { total: 0, blocks: vec![Counted::default(); CODE_BYTES_MAX / 2], others: HashMap::default() }
    }
}

impl Work {
    /// A block, whose instructions `length` counts if it is new.
    fn counted(&mut self, block: Block, length: impl FnOnce() -> u32) -> &mut Counted {
        let (address, bytes) = block;
        let at = (address.wrapping_sub(FLASH) / 2) as usize;
        let is_here = self.blocks.get(at).is_some_and(|known| known.bytes == 0 || known.bytes == bytes);
        let counted = if is_here { &mut self.blocks[at] } else { self.others.entry(block).or_default() };
        if counted.bytes == 0 {
            (counted.bytes, counted.instructions) = (bytes, length());
        }
        counted
    }

    /// A block is executed; `length` counts its instructions if it is new. Returns them.
    pub(crate) fn add(&mut self, block: Block, length: impl FnOnce() -> u32) -> u32 {
        let counted = self.counted(block, length);
        counted.executed += i64::from(counted.instructions);
        let count = counted.instructions;
        self.total += u64::from(count);
        count
    }

    /// A part of a block was not executed after all.
    pub(crate) fn take_back(&mut self, part: Block, length: impl FnOnce() -> u32) -> u32 {
        let counted = self.counted(part, length);
        counted.executed -= i64::from(counted.instructions);
        let count = counted.instructions;
        self.total -= u64::from(count);
        count
    }

    /// Instructions executed since this was last asked, by the addresses of blocks.
    pub(crate) fn take(&mut self) -> impl Iterator<Item = (u32, i64)> {
        let blocks = (FLASH..).step_by(2).zip(&mut self.blocks);
        let all = blocks.chain(self.others.iter_mut().map(|(&(address, _), counted)| (address, counted)));
        let taken = all.map(|(address, counted)| (address, std::mem::take(&mut counted.executed)));
        taken.filter(|&(_, executed)| executed != 0)
    }
}
