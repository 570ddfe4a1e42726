//! The policy of a rule: what it allows, and how it handles the rest.

use embassy_time::Duration;

use crate::modbus::Exception;
use crate::modbus::pdu::function::Form;
use crate::modbus::pdu::{self, Extent, Touched};
use crate::settings::Functions;

/// How a read may share transactions and cached responses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sharing {
    /// The waiting reads with which it may share a transaction.
    pub merge: Merge,
    /// The maximum age of a cached response; 0: no cache. Not a [`Duration`], as rows of the table must be small.
    pub cache_ms: u16,
}

impl Sharing {
    /// Identical reads are merged, since that does not make the response older; the cache is not used.
    pub const DEFAULT: Self = Self { merge: Merge::Identical, cache_ms: 0 };

    /// The maximum age of a cached response.
    pub fn cache(&self) -> Duration {
        Duration::from_millis(self.cache_ms.into())
    }
}

/// Which waiting reads may share a transaction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Merge {
    /// None.
    Off,
    /// Identical ones.
    Identical,
    /// Also reads of coils, inputs or registers that overlap, touch, or have at most this many unwanted addresses in between,
    /// which are read too.
    Near(u8),
}

/// Whether frames are forwarded while they arrive (cut-through), or when they are complete.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Cut {
    /// Where the board's transmitters never underrun.
    #[default]
    Auto,
    /// Wherever possible.
    On,
    /// Never.
    Off,
}

/// Priority in a destination's queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Priority {
    /// Before all others.
    High,
    /// The default.
    #[default]
    Normal,
    /// When nothing else waits, or after a bounded number of others.
    Low,
}

/// What a rule allows, and its priority.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Policy {
    /// Functions that are allowed; others get 01h.
    pub functions: Functions,
    /// Data addresses that may be accessed; a request for others gets 02h, one that does not name its addresses 01h.
    pub addresses: AddressRange,
    /// Data addresses that may be written; a write to others gets 02h, one that may write anything 01h.
    pub writes: AddressRange,
    /// How a forbidden write is handled.
    pub forbidden: Forbidden,
    /// Priority in the destination's queue.
    pub priority: Priority,
    /// Functions with high priority whatever `priority` says.
    pub urgent: Functions,
    /// How a read may share transactions and cached responses.
    pub sharing: Sharing,
    /// Whether frames between serial lines are cut through.
    pub cut: Cut,
}

/// Handling of a write that a rule forbids.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Forbidden {
    /// It gets an exception.
    #[default]
    Refuse,
    /// It is confirmed without being executed, for masters that stop at an exception: functions 5, 6, 15 and 16. Others are
    /// refused.
    Ignore,
}

impl Default for Policy {
    /// Everything is allowed, with normal priority.
    fn default() -> Self {
        Self {
            functions: Functions::ALL,
            addresses: AddressRange::ALL,
            writes: AddressRange::ALL,
            forbidden: Forbidden::Refuse,
            priority: Priority::Normal,
            urgent: Functions::NONE,
            sharing: Sharing::DEFAULT,
            cut: Cut::Auto,
        }
    }
}

impl Policy {
    /// The priority of `request`, which may be incomplete, or the exception that it gets.
    pub fn admit(&self, request: &[u8]) -> Result<Priority, Exception> {
        // The usual case. Also accepts a request of which only the unit has arrived.
        if self.looks_at_nothing() {
            return Ok(self.priority);
        }
        if !self.functions.admit(request) {
            return Err(Exception::ILLEGAL_FUNCTION);
        }
        if self.looks_at_addresses() {
            self.admit_addresses(request)?;
        }
        Ok(if self.urgent.admit(request) { Priority::High } else { self.priority })
    }

    /// A request that cannot be judged is refused, as it could bypass the range.
    fn admit_addresses(&self, request: &[u8]) -> Result<(), Exception> {
        let passes = |extent: &Extent| {
            self.addresses.contains(extent) && (!extent.write || self.writes.contains(extent))
        };
        match pdu::touched(request) {
            Touched::Cells(extents) if extents.iter().flatten().all(passes) => Ok(()),
            Touched::Cells(_) => Err(Exception::ILLEGAL_ADDRESS),
            Touched::Other if self.addresses == AddressRange::ALL => Ok(()),
            Touched::Other | Touched::Unknown => Err(Exception::ILLEGAL_FUNCTION),
        }
    }

    /// Whether the policy depends on the function.
    fn looks_at_functions(&self) -> bool {
        !self.functions.is(&Functions::ALL) || !self.urgent.is(&Functions::NONE)
    }

    /// Whether the policy is the same for all requests.
    pub(crate) fn looks_at_nothing(&self) -> bool {
        !self.looks_at_functions() && !self.looks_at_addresses()
    }

    /// Whether the policy depends on data addresses.
    pub(crate) fn looks_at_addresses(&self) -> bool {
        self.addresses != AddressRange::ALL || self.writes != AddressRange::ALL
    }

    /// Whether the forbidden `request` is confirmed without being executed.
    pub(crate) fn ignores(&self, request: &[u8]) -> bool {
        let has_echo = matches!(Form::of(request), Some(Form::WriteOne(_) | Form::WriteMany(_)));
        self.forbidden == Forbidden::Ignore && has_echo
    }
}

/// Data addresses from `first` to `last`, as on the wire, inclusive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AddressRange {
    /// Lowest address.
    pub first: u16,
    /// Highest address, not below `first`.
    pub last: u16,
}

impl AddressRange {
    /// Every address.
    pub const ALL: Self = Self { first: 0, last: u16::MAX };

    /// The intersection.
    pub(crate) fn common(&self, other: &Self) -> Self {
        Self { first: self.first.max(other.first), last: self.last.min(other.last) }
    }

    /// Whether `extent` is in the range. One that wraps around 65535 is only in the full range.
    pub fn contains(&self, extent: &Extent) -> bool {
        *self == Self::ALL || self.first <= extent.first && extent.last <= u32::from(self.last)
    }
}
