//! SDO information: lists and describes objects (ETG.1000.6, clause 5.6.3).
//!
//! A response longer than the mailbox goes out in fragments, each built when there is room for it. A list is not stored: each
//! fragment looks up its part in the table, so a list may have any length.

use core::fmt::Write;

use heapless::Vec;

use super::abort::Abort;
use super::service::Service;
use crate::application::Application;
use crate::catalogue::Catalogue;
use crate::dictionary::Dictionary;
use crate::mailbox::{MailboxError, Payload};
use crate::object::{Access, Entries, Entry, Object};

/// Bytes of each message's header: operation, reserved, fragments left.
const HEADER_BYTES: usize = 4;
const INCOMPLETE: u8 = 1 << 7;

const LIST: u8 = 1;
const OBJECT: u8 = 3;
const ENTRY: u8 = 5;
/// A response's operation is that of its request plus one.
const RESPONSE: u8 = 1;
const ERROR: u8 = 7;

/// The values that an entry's description includes.
mod value_info {
    pub(super) const DEFAULT: u8 = 1 << 4;
    pub(super) const LEAST: u8 = 1 << 5;
    pub(super) const GREATEST: u8 = 1 << 6;
}

/// Number of lists.
const LISTS: u16 = 5;

/// Most bytes of a description: its numbers, and a name of more than a hundred letters.
const DESCRIPTION_BYTES_MAX: usize = 160;

/// The response being sent.
#[derive(Debug, Default)]
pub struct Information {
    operation: u8,
    /// A description, or the start of a list.
    response: Vec<u8, DESCRIPTION_BYTES_MAX>,
    sent: usize,
    list: Rest,
}

/// The objects of a list not sent yet.
#[derive(Debug, Default)]
struct Rest {
    list: u16,
    count: usize,
    /// Index to continue from.
    from: u16,
}

impl Rest {
    fn of<A: Application>(list: u16, catalogue: &Catalogue<'_, A>) -> Self {
        let count = catalogue.objects_from(0).filter(|object| is_listed(object, list)).count();
        Self { list, count, from: 0 }
    }

    fn next<A: Application>(&mut self, catalogue: &Catalogue<'_, A>) -> Option<u16> {
        let object = catalogue.objects_from(self.from).find(|object| is_listed(object, self.list));
        let Some(object) = object.filter(|_| self.count > 0) else {
            // Modules may have been removed meanwhile.
            self.count = 0;
            return None;
        };
        (self.count, self.from) = (self.count - 1, object.index.saturating_add(1));
        Some(object.index)
    }
}

/// Why a request failed.
enum Refusal {
    Malformed,
    Abort(Abort),
}

impl From<Abort> for Refusal {
    fn from(abort: Abort) -> Self {
        Self::Abort(abort)
    }
}

impl Information {
    /// Takes a request and builds its response.
    pub(super) fn request<A: Application>(
        &mut self,
        body: &[u8],
        dictionary: &Dictionary<'_, A>,
    ) -> Result<(), MailboxError> {
        let (&[operation, _, _, _], data) =
            body.split_first_chunk::<HEADER_BYTES>().ok_or(MailboxError::SizeTooShort)?;
        self.sent = 0;
        self.operation = operation.wrapping_add(RESPONSE);
        self.response.clear();
        self.list = Rest::default();
        match self.describe(operation, data, dictionary) {
            Ok(()) => Ok(()),
            Err(Refusal::Malformed) => {
                self.response.clear();
                Err(MailboxError::SizeTooShort)
            }
            Err(Refusal::Abort(abort)) => {
                self.operation = ERROR;
                self.response = Vec::from_array((abort as u32).to_le_bytes());
                Ok(())
            }
        }
    }

    fn describe<A: Application>(
        &mut self,
        operation: u8,
        data: &[u8],
        dictionary: &Dictionary<'_, A>,
    ) -> Result<(), Refusal> {
        let word = |at: usize| match data.get(at..at + 2) {
            Some(&[low, high]) => Ok(u16::from_le_bytes([low, high])),
            _ => Err(Refusal::Malformed),
        };
        let catalogue = dictionary.catalogue();
        let object = |index| catalogue.object(index).ok_or(Abort::NoObject);
        match operation {
            LIST => self.list(&catalogue, word(0)?),
            OBJECT => self.object(&object(word(0)?)?),
            ENTRY => {
                let (index, selected) = (word(0)?, word(2)?);
                let [sub, wanted] = selected.to_le_bytes();
                let entry = object(index)?.entry(sub).ok_or(Abort::NoEntry)?;
                self.put(&index.to_le_bytes())?;
                self.entry(sub, wanted, entry)
            }
            _ => Err(Abort::UnknownCommand.into()),
        }
    }

    /// The objects of a list; list 0 is the number of objects in each list.
    fn list<A: Application>(&mut self, catalogue: &Catalogue<'_, A>, list: u16) -> Result<(), Refusal> {
        if list > LISTS {
            return Err(Abort::UnsupportedAccess.into());
        }
        self.put(&list.to_le_bytes())?;
        if list == 0 {
            let counts = (1..=LISTS).map(|list| Rest::of(list, catalogue).count as u16);
            return counts.into_iter().try_for_each(|count| self.put(&count.to_le_bytes()));
        }
        self.list = Rest::of(list, catalogue);
        Ok(())
    }

    fn object(&mut self, object: &Object) -> Result<(), Refusal> {
        self.put(&object.index.to_le_bytes())?;
        self.put(&object.data_type().to_le_bytes())?;
        self.put(&[object.sub_max(), object.code()])?;
        self.put(object.name.as_bytes())
    }

    fn entry(&mut self, sub: u8, wanted: u8, entry: Entry) -> Result<(), Refusal> {
        let default = entry.default_number().filter(|_| wanted & value_info::DEFAULT != 0);
        let bounded = entry.data_type.is_number() && entry.access.any(Access::WRITE);
        let least = (bounded && wanted & value_info::LEAST != 0).then_some(u64::from(entry.range.0));
        let greatest = (bounded && wanted & value_info::GREATEST != 0).then_some(entry.greatest());
        let values =
            [(value_info::DEFAULT, default), (value_info::LEAST, least), (value_info::GREATEST, greatest)];
        let given = values.iter().filter(|(_, value)| value.is_some()).map(|(bit, _)| bit).sum();
        self.put(&[sub, given])?;
        for word in [entry.data_type.code(), entry.data_type.bits(), entry.access.0] {
            self.put(&word.to_le_bytes())?;
        }
        for value in values.into_iter().filter_map(|(_, value)| value) {
            self.put(value.to_le_bytes().get(..entry.data_type.bytes()).unwrap_or_default())?;
        }
        write!(self.response, "{}", entry.label()).map_err(|_| Refusal::Abort(Abort::OutOfMemory))
    }

    fn put(&mut self, bytes: &[u8]) -> Result<(), Refusal> {
        self.response.extend_from_slice(bytes).map_err(|_| Refusal::Abort(Abort::OutOfMemory))
    }

    /// Number of unsent bytes.
    fn left(&self) -> usize {
        self.response.len() - self.sent + 2 * self.list.count
    }

    /// Whether fragments are left.
    pub(super) fn is_responding(&self) -> bool {
        self.left() > 0
    }

    /// The next fragment, in `room` bytes at most.
    pub(super) fn next<A: Application>(
        &mut self,
        room: usize,
        catalogue: &Catalogue<'_, A>,
    ) -> Option<Payload> {
        if !self.is_responding() {
            return None;
        }
        // An even number, so that no index of a list is split.
        let data_max = (room - HEADER_BYTES) & !1;
        let rest = self.response.get(self.sent..).unwrap_or_default();
        let described = rest.get(..data_max).unwrap_or(rest);
        let mut data = Payload::from_slice(described).unwrap_or_default();
        self.sent += described.len();
        let indices = core::iter::from_fn(|| self.list.next(catalogue));
        for index in indices.take((data_max - data.len()) / 2) {
            // A fragment fits the mailbox, and thus the payload.
            let _ = data.extend_from_slice(&index.to_le_bytes());
        }
        let left = self.left().div_ceil(data_max);
        let incomplete = if left > 0 { INCOMPLETE } else { 0 };
        let [low, high] = (left as u16).to_le_bytes();
        Some(Service::SdoInformation.message(&[&[self.operation | incomplete, 0, low, high], &data]))
    }
}

/// Whether an object belongs to a list: all, mappable to RxPDOs, to TxPDOs, stored at power-off, start-up settings.
fn is_listed(object: &Object, list: u16) -> bool {
    const BACKUP: Access = Access(0x0100);
    let wanted = match list {
        1 => return true,
        2 => Access::RX_PDO,
        3 => Access::TX_PDO,
        4 => BACKUP,
        5 => Access::SETTING,
        _ => return false,
    };
    match object.entries {
        // All entries have the same rights.
        Entries::Variable(entry) | Entries::Array(_, entry) | Entries::Constants(_, entry) => {
            entry.access.any(wanted)
        }
        Entries::Record(entries) => entries.iter().any(|entry| entry.access.any(wanted)),
        Entries::Assignment(_, access) => access.any(wanted),
        Entries::Mapping(..) => false,
    }
}
