//! Who saved the text that is valid and the one before it.

use core::fmt::{self, Write};

use heapless::String;

use crate::head::{HEAD_BYTES, Head};

/// Who saves: a name with an address. What does not fit is left out.
pub(crate) type Who = String<WHO_BYTES_MAX>;
const WHO_BYTES_MAX: usize = 52;

/// Who saves, in words.
pub(crate) fn who(who: &dyn fmt::Display) -> Who {
    let mut words = Who::new();
    // See `Who`.
    let _ = write!(words, "{who}");
    words
}

/// Bytes of a copy's item: its head, and who saved it.
pub(super) const VERSION_BYTES_MAX: usize = HEAD_BYTES + WHO_BYTES_MAX;

/// Each copy's head, and who saved it.
pub(super) struct Versions {
    pub(super) copies: [Option<(Head, Who)>; 2],
    /// Who makes the next one.
    pub(super) signed: Who,
}

impl Versions {
    pub(super) const fn new() -> Self {
        Self { copies: [const { None }; 2], signed: String::new() }
    }

    pub(super) fn sign(&mut self, who: &dyn fmt::Display) {
        self.signed = self::who(who);
    }

    /// The copy is being overwritten.
    pub(super) fn forget(&mut self, copy: u8) {
        self.set(copy, None);
    }

    pub(super) fn set(&mut self, copy: u8, version: Option<(Head, Who)>) {
        self.copies.get_mut(usize::from(copy)).into_iter().for_each(|place| *place = version.clone());
    }
}
