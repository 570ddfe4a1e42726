//! How a client-side port proves that a unit has answered all earlier requests: see [`outstanding`](crate::gateway::outstanding).

use crate::scanner::Kind;
use crate::settings::UnitRange;

/// Unit ranges of a port with their own proof.
pub(crate) const PROOFS_MAX: usize = if cfg!(feature = "small") { 2 } else { 4 };

/// The request sent to a unit whose responses could otherwise be confused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Proof {
    /// Function 8 with a number; for a unit that ignores it, a read that clients use there.
    #[default]
    Auto,
    /// Function 8, sub-function 0, with a number.
    Diagnostic,
    /// This read, which must differ by function or byte count from what clients send.
    Read {
        /// The table.
        kind: Kind,
        /// The first address, as on the wire.
        address: u16,
        /// Coils, inputs or registers.
        count: u16,
    },
    /// No proof: the late window is waited for.
    None,
}

/// The proofs of a port's units.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Proofs {
    /// For all units that are not in `of_units`.
    pub all: Proof,
    /// For some units; the first matching range applies.
    pub of_units: [Option<(UnitRange, Proof)>; PROOFS_MAX],
}

impl Proofs {
    /// The proof of `unit`.
    pub fn of(&self, unit: u8) -> Proof {
        let mut of_units = self.of_units.iter().flatten();
        of_units.find(|(units, _)| units.contains(unit)).map_or(self.all, |(_, proof)| *proof)
    }
}
