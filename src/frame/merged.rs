//! Frames that travel with another one, whose response is theirs.

use core::mem;

use super::Frame;

impl<'p> Frame<'p> {
    /// Lets `merged`, which rides on no frame and is in no channel, ride on this one, in front of those that do so already.
    pub fn merge(&self, merged: Frame<'p>) {
        let link = merged.index + 1;
        let behind = self.with(|slot| mem::replace(&mut slot.merged, link));
        merged.with(|slot| slot.next = behind.unwrap_or(0));
        // This frame holds the handle from here on, as an index.
        mem::forget(merged);
    }

    /// Whether others ride on this frame.
    pub fn has_merged(&self) -> bool {
        self.with(|slot| slot.merged != 0) == Some(true)
    }

    /// Takes the first of the frames that ride on this one.
    pub fn take_merged(&self) -> Option<Frame<'p>> {
        let index = self.with(|slot| slot.merged)?.checked_sub(1)?;
        let merged = Self { pool: self.pool, index };
        let next = merged.with(|slot| mem::take(&mut slot.next));
        self.with(|slot| slot.merged = next.unwrap_or(0));
        Some(merged)
    }
}
