//! How many instructions were executed, and where.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

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

/// Counts of instructions.
#[derive(Default)]
pub(crate) struct Work {
    /// All since the beginning.
    pub(crate) total: u64,
    /// Of each block that was met its instructions, and how many of them were executed.
    blocks: HashMap<Block, (u32, i64), BuildHasherDefault<Mix>>,
}

impl Work {
    /// A block is executed; `length` counts its instructions if it is new. Returns them.
    pub(crate) fn add(&mut self, block: Block, length: impl FnOnce() -> u32) -> u32 {
        let (count, executed) = self.blocks.entry(block).or_insert_with(|| (length(), 0));
        *executed += i64::from(*count);
        self.total += u64::from(*count);
        *count
    }

    /// A part of a block was not executed after all.
    pub(crate) fn take_back(&mut self, part: Block, length: impl FnOnce() -> u32) -> u32 {
        let (count, executed) = self.blocks.entry(part).or_insert_with(|| (length(), 0));
        *executed -= i64::from(*count);
        self.total -= u64::from(*count);
        *count
    }

    /// Instructions executed since this was last asked, by the addresses of blocks.
    pub(crate) fn take(&mut self) -> impl Iterator<Item = (u32, i64)> {
        self.blocks.iter_mut().map(|(&(address, _), (_, executed))| (address, std::mem::take(executed)))
    }
}
