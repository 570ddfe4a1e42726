//! The `proof` option: `diagnostic, none for 17, read holding 0 count 2 for 20-29`.

use core::fmt::{self, Display};

use super::point_words::KINDS;
use super::route_words::units;
use super::values::number;
use super::words::{Word, Words, Wrong};
use crate::scanner::Kind;
use crate::settings::{PROOFS_MAX, Proof, Proofs};

/// The text contains the limit.
const PROOFS_EXPECTED: &str = match PROOFS_MAX {
    2 => "proofs for at most 2 ranges of units",
    4 => "proofs for at most 4 ranges of units",
    _ => panic!("another text is needed"),
};

/// The read's table, address and count follow the keyword.
const PROOFS: &[(&str, Proof)] = &[
    ("auto", Proof::Auto),
    ("diagnostic", Proof::Diagnostic),
    ("read", Proof::Read { kind: Kind::Holding, address: 0, count: 1 }),
    ("none", Proof::None),
];

impl Proofs {
    /// Parses `diagnostic, none for 17, read holding 0 count 2 for 20-29`, whose first word is `word`.
    pub(crate) fn read<'w>(mut word: Word<'w>, words: &'w Words) -> Result<Self, Wrong> {
        let (mut proofs, mut free) = (Self::default(), 0..PROOFS_MAX);
        loop {
            let proof = Proof::read(word, words)?;
            if words.peek().is("for") {
                words.take();
                let units = units(words.take())?;
                let index = free.next().and_then(|index| proofs.of_units.get_mut(index));
                *index.ok_or_else(|| word.expected(PROOFS_EXPECTED))? = Some((units, proof));
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
                write!(f, "read {kind} {address}")?;
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
