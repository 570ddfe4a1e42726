//! Combines reads of neighbouring addresses into one. Pure.

use crate::frame::Frame;
use crate::modbus::pdu::Block;
use crate::port::client::dispatcher::entry::block;
use crate::settings::{AddressRange, Merge};

/// A read that may be combined with others, or the result of combining several.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct CombinedRead {
    /// What it reads.
    pub(super) block: Block,
    /// The largest gap between two reads that all rules allow, and the largest that occurs.
    gap_allowed: u16,
    gap: u16,
    /// The addresses that all rules allow.
    addresses: AddressRange,
}

impl CombinedRead {
    /// The read in `frame`, if its rule allows combining.
    pub(super) fn of(frame: &Frame<'_>) -> Option<Self> {
        let Merge::Near(gap_allowed) = frame.sharing().merge else { return None };
        let addresses = frame.read(|envelope| envelope.addresses);
        Some(Self { block: block(frame)?, gap_allowed: gap_allowed.into(), gap: 0, addresses })
    }

    /// Combines two reads, if both rules allow it.
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

    /// Combines this read with all of `others` that fit, including those that become neighbours only through one in between.
    pub(super) fn combine_all<I: Iterator<Item = Self>>(mut self, others: impl Fn() -> I) -> Self {
        loop {
            let before = self.block;
            for other in others() {
                self = self.combine(&other).unwrap_or(self);
            }
            // Terminates: every round but the last grows the block, up to the length limit of a request.
            if self.block == before {
                return self;
            }
        }
    }

    /// Whether this read covers `other`.
    pub(super) fn serves(&self, other: &Self) -> bool {
        self.combine(other).is_some_and(|combined| combined.block == self.block)
    }
}
