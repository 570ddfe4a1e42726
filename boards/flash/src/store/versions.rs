//! The last texts that were saved: where they are, when they were saved, and by whom.

use core::fmt::{self, Display, Write};

use embedded_storage_async::nor_flash::NorFlash;
use heapless::Vec;
use mobgate::gateway::date::Date;

use super::ring::{RECORD_BYTES, Ring, SIGNATURE_BYTES, VERSIONS_MAX, pieces, versions_max};
use crate::head::{HEAD_BYTES, Head};

/// Microseconds of a second.
const SECOND: u64 = 1_000_000;

/// Who saves, and when, as it is in the flash: seconds since 1970 began, 0 if the time is unknown; and a name with an address, behind which
/// are zeros. What does not fit is left out.
pub(crate) struct Signature([u8; SIGNATURE_BYTES]);

impl Signature {
    /// Nobody's.
    pub(crate) const fn new() -> Self {
        Self([0; SIGNATURE_BYTES])
    }

    pub(crate) fn of(who: &dyn Display, when: impl FnOnce() -> Option<u64>) -> Self {
        let at = when().and_then(|us| u32::try_from(us / SECOND).ok()).unwrap_or_default();
        let mut bytes = Vec::<u8, SIGNATURE_BYTES>::new();
        // Sized for the time; of the name see above.
        let _ = bytes.extend_from_slice(&at.to_le_bytes());
        let _ = write!(bytes, "{who}");
        let _ = bytes.resize_default(SIGNATURE_BYTES);
        Self(bytes.into_array().unwrap_or([0; SIGNATURE_BYTES]))
    }
}

impl Default for Signature {
    fn default() -> Self {
        Self::new()
    }
}

/// What is known of a version, as it is in the flash.
pub(super) type Record = [u8; RECORD_BYTES];

fn record(head: Head, signature: &Signature) -> Record {
    let mut record = [0; RECORD_BYTES];
    if let Some((first, rest)) = record.split_first_chunk_mut() {
        *first = head.to_bytes();
        rest.copy_from_slice(&signature.0);
    }
    record
}

/// The head of a version; `None` if another firmware version wrote it.
pub(super) fn head(record: &Record) -> Option<Head> {
    Head::from_bytes(record.first_chunk::<HEAD_BYTES>()?)
}

/// When a version was saved, and by whom: as a store tells it.
pub(super) struct Told<'v>(&'v [u8]);

impl Display for Told<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some((at, who)) = self.0.split_first_chunk() else { return Ok(()) };
        match u32::from_le_bytes(*at) {
            0 => f.write_str("-")?,
            at => Date(u64::from(at) * SECOND).fmt(f)?,
        }
        let who = who.split(|byte| *byte == 0).next().unwrap_or_default();
        write!(f, "\t-\t{}", core::str::from_utf8(who).unwrap_or_default())
    }
}

/// The versions, from the valid text on to the oldest.
pub(super) struct Versions {
    pub(super) records: Vec<Record, VERSIONS_MAX>,
    /// Whose the next one is.
    pub(super) signed: Signature,
}

impl Versions {
    pub(super) const fn new() -> Self {
        Self { records: Vec::new(), signed: Signature::new() }
    }

    /// The version `nth`.
    pub(super) fn get(&self, nth: usize) -> Option<(Head, Told<'_>)> {
        let record = self.records.get(nth)?;
        Some((head(record)?, Told(record.get(HEAD_BYTES..)?)))
    }

    /// Makes the text of `head` the first one.
    pub(super) fn add<F: NorFlash>(&mut self, head: Head, signature: &Signature) {
        self.records.truncate(versions_max(Ring::<F>::PLACES) - 1);
        // Sized for it.
        let _ = self.records.insert(0, record(head, signature));
    }

    /// Drops what was saved after `valid`, which holds again. Other firmware may have saved it: then nobody is known to have.
    pub(super) fn go_back<F: NorFlash>(&mut self, valid: Option<Head>) {
        let Some(valid) = valid else { return self.records.clear() };
        match self.records.iter().position(|record| head(record) == Some(valid)) {
            Some(nth) => (0..nth).for_each(|_| _ = self.records.remove(0)),
            None => self.add::<F>(valid, &Signature::new()),
        }
    }

    /// Drops the version that has a piece in `place`; whether there was one.
    pub(super) fn give_up<F: NorFlash>(&mut self, place: usize) -> bool {
        let is_there = |head| {
            let nth = (place + Ring::<F>::PLACES - Ring::<F>::place(head, 0)) % Ring::<F>::PLACES;
            nth < pieces(head)
        };
        let count = self.records.len();
        self.records.retain(|record| !head(record).is_none_or(is_there));
        self.records.len() < count
    }

    /// Where the next text begins: behind the valid one. With all versions there, the ring begins anew as soon as the longest text would
    /// not reach the valid one: what is in further places would have to be moved with each full sector.
    pub(super) fn next<F: NorFlash>(&self, valid: Option<Head>) -> u8 {
        let Some(valid) = valid else { return 0 };
        let start = Ring::<F>::place(valid, 0);
        let is_out_of_reach = start >= Ring::<F>::HALF && start + pieces(valid) <= Ring::<F>::PLACES;
        let is_last = self.records.iter().filter_map(head).all(|head| Ring::<F>::place(head, 0) <= start);
        if is_out_of_reach && is_last && self.records.is_full() { 0 } else { Ring::<F>::behind(valid) }
    }
}
