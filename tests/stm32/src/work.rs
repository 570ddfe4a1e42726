//! How many instructions were executed, and where.

use std::collections::HashMap;

/// A block's address and length in bytes.
pub(crate) type Block = (u32, u32);

/// Counts of instructions.
#[derive(Default)]
pub(crate) struct Work {
    /// All since the beginning.
    pub(crate) total: u64,
    /// Of each block that was met its instructions, and how many of them were executed.
    blocks: HashMap<Block, (u32, i64)>,
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
