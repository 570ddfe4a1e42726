//! Merged frames: requests linked to the one whose response also serves them.

use core::mem;

use super::Frame;

impl<'p> Frame<'p> {
    /// Links `merged`, which must be in no channel, to this frame, ahead of those already linked.
    pub fn merge(&self, merged: Frame<'p>) {
        let link = merged.index + 1;
        let behind = self.with(|slot| mem::replace(&mut slot.merged, link));
        merged.with(|slot| slot.next = behind.unwrap_or(0));
        // This frame now owns the handle, as an index.
        mem::forget(merged);
    }

    /// Whether other frames are merged into this one.
    pub fn has_merged(&self) -> bool {
        self.with(|slot| slot.merged != 0) == Some(true)
    }

    /// Unlinks and returns the first merged frame.
    pub fn take_merged(&self) -> Option<Frame<'p>> {
        let index = self.with(|slot| slot.merged)?.checked_sub(1)?;
        let merged = Self { pool: self.pool, index };
        let next = merged.with(|slot| mem::take(&mut slot.next));
        self.with(|slot| slot.merged = next.unwrap_or(0));
        Some(merged)
    }
}
