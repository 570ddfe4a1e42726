//! Versions of firmware, ordered as by Semantic Versioning, in eight bytes.

use core::fmt;

/// A version: `1.4.0`, or before it `1.4.0-alpha.N`, `-beta.N`, `-rc.N`.
///
/// The order of the fields is that of versions (semver.org, clause 11).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version {
    major: u16,
    minor: u16,
    patch: u16,
    /// What comes before the version itself: its kind in the upper two bits, its number below. All ones is the version itself.
    pre_release: u16,
}

/// Pre-releases, in their order.
const KINDS: [&str; 3] = ["alpha", "beta", "rc"];
const NUMBER_BITS: u32 = 14;
const RELEASED: u16 = u16::MAX;

impl Version {
    /// The version that a package's text says. `None` for what has no place in eight bytes: parts above 65535, pre-releases of
    /// other names or numbers above 16383, build metadata.
    pub const fn parse(text: &str) -> Option<Self> {
        let Some((major, rest)) = number(text.as_bytes()) else { return None };
        let Some((minor, rest)) = number_after(b'.', rest) else { return None };
        let Some((patch, rest)) = number_after(b'.', rest) else { return None };
        let Some(pre_release) = pre_release(rest) else { return None };
        Some(Self { major, minor, patch, pre_release })
    }

    /// The version in an info block.
    pub(crate) const fn from_bytes(bytes: [u8; 8]) -> Self {
        let [a, b, c, d, e, f, g, h] = bytes;
        let [major, minor] = [u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d])];
        let [patch, pre_release] = [u16::from_le_bytes([e, f]), u16::from_le_bytes([g, h])];
        Self { major, minor, patch, pre_release }
    }

    pub(crate) const fn to_bytes(self) -> [u8; 8] {
        let ([a, b], [c, d]) = (self.major.to_le_bytes(), self.minor.to_le_bytes());
        let ([e, f], [g, h]) = (self.patch.to_le_bytes(), self.pre_release.to_le_bytes());
        [a, b, c, d, e, f, g, h]
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}.{}", self.major, self.minor, self.patch)?;
        match KINDS.get(usize::from(self.pre_release >> NUMBER_BITS)) {
            Some(kind) => write!(f, "-{kind}.{}", self.pre_release & ((1 << NUMBER_BITS) - 1)),
            None => Ok(()),
        }
    }
}

/// A number without leading zeros at the start of the text, and what follows it.
const fn number(text: &[u8]) -> Option<(u16, &[u8])> {
    let (mut value, mut rest): (u16, _) = (0, text);
    while let [digit @ b'0'..=b'9', after @ ..] = rest {
        if value == 0 && rest.len() < text.len() {
            return None;
        }
        let Some(tens) = value.checked_mul(10) else { return None };
        let Some(sum) = tens.checked_add((*digit - b'0') as u16) else { return None };
        (value, rest) = (sum, after);
    }
    if rest.len() == text.len() { None } else { Some((value, rest)) }
}

const fn number_after(separator: u8, text: &[u8]) -> Option<(u16, &[u8])> {
    match text {
        [first, rest @ ..] if *first == separator => number(rest),
        _ => None,
    }
}

const fn pre_release(text: &[u8]) -> Option<u16> {
    let (kind, rest) = match text {
        [] => return Some(RELEASED),
        [b'-', b'a', b'l', b'p', b'h', b'a', rest @ ..] => (0, rest),
        [b'-', b'b', b'e', b't', b'a', rest @ ..] => (1, rest),
        [b'-', b'r', b'c', rest @ ..] => (2, rest),
        _ => return None,
    };
    match number_after(b'.', rest) {
        Some((number, [])) if number < 1 << NUMBER_BITS => Some(kind << NUMBER_BITS | number),
        _ => None,
    }
}
