//! How a client-side port finds out that a unit has answered all that it was sent: see [`outstanding`](crate::gateway::outstanding).

use core::fmt::{self, Display};

use super::point_words::KINDS;
use super::route_words::units;
use super::values::number;
use super::words::{Word, Words, Wrong};
use crate::route::UnitRange;
use crate::scanner::Kind;

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

    /// `diagnostic, none for 17, read holding 0 count 2 for 20-29`, whose first word is `word`.
    pub(super) fn read<'w>(mut word: Word<'w>, words: &'w Words) -> Result<Self, Wrong> {
        let (mut proofs, mut places) = (Self::default(), 0..PROOFS_MAX);
        loop {
            let proof = Proof::read(word, words)?;
            if words.peek().is("for") {
                words.take();
                let units = units(words.take())?;
                let place = places.next().and_then(|place| proofs.of_units.get_mut(place));
                *place.ok_or_else(|| word.expected(PROOFS_EXPECTED))? = Some((units, proof));
            } else {
                proofs.all = proof;
            }
            let next = words.peek();
            if next.is_end() || !next.listed {
                return Ok(proofs);
            }
            word = words.take();
        }
    }
}

/// Names the limit as a number.
const PROOFS_EXPECTED: &str = match PROOFS_MAX {
    2 => "proofs for at most 2 ranges of units",
    4 => "proofs for at most 4 ranges of units",
    _ => panic!("another text is needed"),
};

/// The read stands for the word alone: what is read stands behind it.
const PROOFS: &[(&str, Proof)] = &[
    ("auto", Proof::Auto),
    ("diagnostic", Proof::Diagnostic),
    ("read", Proof::Read { kind: Kind::Holding, address: 0, count: 1 }),
    ("none", Proof::None),
];

impl Proof {
    fn read(word: Word, words: &Words) -> Result<Self, Wrong> {
        let proof = word.keyword(PROOFS, "auto, diagnostic, read or none")?;
        let Self::Read { .. } = proof else { return Ok(proof) };
        let kind = words.take().keyword(KINDS, "coil, discrete, input or holding")?;
        let address = number(words.take(), "an address as it is on the wire", 0..=0xFFFF)? as u16;
        let mut count = 1;
        if words.peek().is("count") {
            words.take();
            count = number(words.take(), "how many are read", 1..=u32::from(kind.cells_max(false)))? as u16;
        }
        Ok(Self::Read { kind, address, count })
    }
}

impl Display for Proof {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Diagnostic => f.write_str("diagnostic"),
            Self::None => f.write_str("none"),
            Self::Read { kind, address, count } => {
                let name = KINDS.iter().find(|(_, known)| known == kind).map_or("", |(name, _)| name);
                write!(f, "read {name} {address}")?;
                if *count > 1 { write!(f, " count {count}") } else { Ok(()) }
            }
        }
    }
}

impl Display for Proofs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.all)?;
        self.of_units.iter().flatten().try_for_each(|(units, proof)| write!(f, ", {proof} for {units}"))
    }
}
