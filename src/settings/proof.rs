//! How a client-side port finds out that a unit has answered all that it was sent: see [`outstanding`](crate::gateway::outstanding).

use crate::scanner::Kind;
use crate::settings::UnitRange;

/// Ranges of units of a port that have a proof of their own.
pub const PROOFS_MAX: usize = if cfg!(feature = "small") { 2 } else { 4 };

/// The request that is sent to a unit whose responses could otherwise be mixed up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Proof {
    /// Function 8 with a number; for a unit that leaves that unanswered a read that clients send there.
    #[default]
    Auto,
    /// Function 8, sub-function 0, with a number.
    Diagnostic,
    /// This read, which must differ by its function or byte count from what clients send.
    Read {
        /// The table.
        kind: Kind,
        /// The first address as it is on the wire.
        address: u16,
        /// Coils, inputs or registers.
        count: u16,
    },
    /// There is none: only the late window is waited for.
    None,
}

/// The proofs of a port's units.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Proofs {
    /// Of all units that are not in `of_units`.
    pub all: Proof,
    /// Of some units; the first range that a unit is in counts.
    pub of_units: [Option<(UnitRange, Proof)>; PROOFS_MAX],
}

impl Proofs {
    /// The proof of `unit`.
    pub fn of(&self, unit: u8) -> Proof {
        let mut of_units = self.of_units.iter().flatten();
        of_units.find(|(units, _)| units.contains(unit)).map_or(self.all, |(_, proof)| *proof)
    }
}
