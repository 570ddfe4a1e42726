//! What a rule lets through, and what becomes of the rest.

use embassy_time::Duration;

use crate::modbus::Exception;
use crate::modbus::pdu::function::Form;
use crate::modbus::pdu::{self, Extent, Touched};
use crate::settings::Functions;

/// Whose answers will do for a read besides one that is sent for it alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sharing {
    /// That of a read which was waiting, too, when it was sent.
    pub merge: Merge,
    /// One that is in memory and not older than this; 0: none. A row of the table must be small: no [`Duration`].
    pub cache_ms: u16,
}

impl Sharing {
    /// Identical reads are merged, since the response is as new as it would be otherwise; memory is not used.
    pub const DEFAULT: Self = Self { merge: Merge::Identical, cache_ms: 0 };

    /// How old a response from memory may be.
    pub fn cache(&self) -> Duration {
        Duration::from_millis(self.cache_ms.into())
    }
}

/// Which reads that wait at the same time may be one transaction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Merge {
    /// None.
    Off,
    /// Identical ones.
    Identical,
    /// Also those of coils, inputs or registers that overlap, that touch, or that have at most so many unwanted addresses
    /// between them, which are then read along.
    Near(u8),
}

/// Whether frames are passed on while they arrive (cut-through), or when they are whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Cut {
    /// Where the board's transmitters cannot underrun.
    #[default]
    Auto,
    /// Wherever it can be done.
    On,
    /// Never.
    Off,
}

/// Rank in a destination's queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Priority {
    /// Before all others.
    High,
    /// The default.
    #[default]
    Normal,
    /// When nothing else waits, and in any case after a bounded number of others.
    Low,
}

/// What a rule lets through, and with which rank.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Policy {
    /// Which functions pass; others are answered 01h.
    pub functions: Functions,
    /// Data addresses that may be touched; a request for others is answered 02h, one that does not say what it touches 01h.
    pub addresses: AddressRange,
    /// Data addresses that may be written; a write to others is answered 02h, one that may write anything 01h.
    pub writes: AddressRange,
    /// What becomes of a write that does not pass.
    pub forbidden: Forbidden,
    /// Rank in the destination's queue.
    pub priority: Priority,
    /// Functions that rank high whatever `priority` says.
    pub urgent: Functions,
    /// Whose answers will do for a read.
    pub sharing: Sharing,
    /// Whether frames from one serial line to another are passed on while they arrive.
    pub cut: Cut,
}

/// What becomes of a write that a rule does not let pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Forbidden {
    /// It is answered with an exception.
    #[default]
    Refuse,
    /// It is answered as if it had been carried out, for masters that stop at an exception: functions 5, 6, 15 and 16. Others
    /// are refused.
    Ignore,
}

impl Default for Policy {
    /// Everything passes, with normal priority.
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
    /// The rank of `request`, or of what has arrived of it, or the exception that it gets.
    pub fn admit(&self, request: &[u8]) -> Result<Priority, Exception> {
        // Mostly: also a request of which only the unit has come.
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

    /// What cannot be judged is refused: a range that something gets around is none.
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

    /// Whether some functions are not like others.
    fn looks_at_functions(&self) -> bool {
        self.functions != Functions::ALL || self.urgent != Functions::NONE
    }

    /// Whether all requests are alike.
    pub(crate) fn looks_at_nothing(&self) -> bool {
        !self.looks_at_functions() && !self.looks_at_addresses()
    }

    /// Whether some addresses are not like others.
    pub(crate) fn looks_at_addresses(&self) -> bool {
        self.addresses != AddressRange::ALL || self.writes != AddressRange::ALL
    }

    /// Whether `request`, which does not pass, is answered as if it had been carried out.
    pub(crate) fn ignores(&self, request: &[u8]) -> bool {
        let has_echo = matches!(Form::of(request), Some(Form::WriteOne(_) | Form::WriteMany(_)));
        self.forbidden == Forbidden::Ignore && has_echo
    }
}

/// Data addresses from `first` to `last` as they are on the wire, both included.
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

    /// The addresses in both.
    pub(crate) fn common(&self, other: &Self) -> Self {
        Self { first: self.first.max(other.first), last: self.last.min(other.last) }
    }

    /// Whether all of `extent` is in the range. What runs over the end of the addresses, where a device may begin again at 0,
    /// is in none but that of all.
    pub fn contains(&self, extent: &Extent) -> bool {
        *self == Self::ALL || self.first <= extent.first && extent.last <= u32::from(self.last)
    }
}
