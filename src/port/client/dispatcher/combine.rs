//! Reads that may be asked for together: which of those that wait become one, and what is asked then. Pure.

use crate::frame::{Envelope, Frame};
use crate::modbus::pdu::Block;
use crate::port::client::dispatcher::entry::block;
use crate::settings::{AddressRange, Merge};

/// A read that others may join, or what has become of several.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct CombinedRead {
    /// What is asked for.
    pub(super) block: Block,
    /// The most addresses between two reads that all rules allow to be read along, and the most that there are.
    gap_allowed: u16,
    gap: u16,
    /// The addresses that all rules allow.
    addresses: AddressRange,
}

impl CombinedRead {
    /// What `frame` asks for, if its rule lets others join it.
    pub(super) fn of(frame: &Frame<'_>) -> Option<Self> {
        let Merge::Near(gap_allowed) = frame.sharing().merge else { return None };
        let Envelope { addresses, .. } = frame.envelope();
        Some(Self { block: block(frame)?, gap_allowed: gap_allowed.into(), gap: 0, addresses })
    }

    /// Both in one, if the rules of both allow that.
    pub(super) fn combine(&self, other: &Self) -> Option<Self> {
        let combined = Self {
            block: self.block.hull(&other.block)?,
            gap_allowed: self.gap_allowed.min(other.gap_allowed),
            gap: self.gap.max(self.block.distance(&other.block)),
            addresses: self.addresses.common(&other.addresses),
        };
        let allowed =
            combined.gap <= combined.gap_allowed && combined.addresses.contains(&combined.block.extent());
        allowed.then_some(combined)
    }

    /// This read with all of `others` that can be combined, also when only what lies between makes them neighbours.
    pub(super) fn combine_all<I: Iterator<Item = Self>>(mut self, others: impl Fn() -> I) -> Self {
        loop {
            let before = self.block;
            for other in others() {
                self = self.combine(&other).unwrap_or(self);
            }
            // Every round but the last makes the block longer, up to what one request can ask for.
            if self.block == before {
                return self;
            }
        }
    }

    /// Whether `other` is a part of this.
    pub(super) fn serves(&self, other: &Self) -> bool {
        self.combine(other).is_some_and(|combined| combined.block == self.block)
    }
}
