//! SDO information: which objects there are, and what they are like (ETG.1000.6, clause 5.6.3).
//!
//! An answer that is longer than the mailbox goes out in fragments, each built when there is room for it.

use heapless::Vec;

use super::Service;
use super::abort::Abort;
use crate::application::Application;
use crate::dictionary::{Bytes, Dictionary};
use crate::mailbox::{MailboxError, Payload};
use crate::object::{Access, Entry, Object};

/// Bytes of the header in front of each message: operation, reserved, fragments left.
const HEADER_BYTES: usize = 4;
const INCOMPLETE: u8 = 1 << 7;

const LIST: u8 = 1;
const OBJECT: u8 = 3;
const ENTRY: u8 = 5;
/// An answer's operation is its request's and one more.
const ANSWER: u8 = 1;
const ERROR: u8 = 7;

/// Which values an entry's description brings along.
mod value_info {
    pub(super) const DEFAULT: u8 = 1 << 4;
    pub(super) const LEAST: u8 = 1 << 5;
    pub(super) const GREATEST: u8 = 1 << 6;
}

/// The lists of objects, by number.
const LISTS: u16 = 5;

/// The answer that is being sent.
#[derive(Debug, Default)]
pub struct Information {
    operation: u8,
    answer: Bytes,
    sent: usize,
}

/// Why there is no description.
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
    /// Takes a request and builds its answer.
    pub(super) fn request<A: Application>(
        &mut self,
        body: &[u8],
        dictionary: &Dictionary<'_, A>,
    ) -> Result<(), MailboxError> {
        let (&[operation, _, _, _], data) =
            body.split_first_chunk::<HEADER_BYTES>().ok_or(MailboxError::SizeTooShort)?;
        self.sent = 0;
        self.operation = operation.wrapping_add(ANSWER);
        self.answer.clear();
        match self.describe(operation, data, dictionary) {
            Ok(()) => Ok(()),
            Err(Refusal::Malformed) => {
                self.answer.clear();
                Err(MailboxError::SizeTooShort)
            }
            Err(Refusal::Abort(abort)) => {
                self.operation = ERROR;
                self.answer = Vec::from_array((abort as u32).to_le_bytes());
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
        let objects = dictionary.device.objects;
        let object = |index| dictionary.device.object(index).ok_or(Abort::NoObject);
        match operation {
            LIST => self.list(objects, word(0)?),
            OBJECT => self.object(object(word(0)?)?),
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

    /// The objects of a list, or for list 0 how many each list has.
    fn list(&mut self, objects: &[Object], list: u16) -> Result<(), Refusal> {
        if list > LISTS {
            return Err(Abort::UnsupportedAccess.into());
        }
        self.put(&list.to_le_bytes())?;
        if list == 0 {
            for list in 1..=LISTS {
                let count = objects.iter().filter(|object| is_listed(object, list)).count();
                self.put(&(count as u16).to_le_bytes())?;
            }
        }
        for object in objects.iter().filter(|object| is_listed(object, list)) {
            self.put(&object.index.to_le_bytes())?;
        }
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
        let least = (bounded && wanted & value_info::LEAST != 0).then_some(entry.range.0);
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
        self.put(entry.name.as_bytes())
    }

    fn put(&mut self, bytes: &[u8]) -> Result<(), Refusal> {
        self.answer.extend_from_slice(bytes).map_err(|_| Refusal::Abort(Abort::OutOfMemory))
    }

    /// Whether fragments are left.
    pub(super) fn is_answering(&self) -> bool {
        self.sent < self.answer.len()
    }

    /// The next fragment, in `room` bytes at most.
    pub(super) fn next(&mut self, room: usize) -> Option<Payload> {
        let rest = self.answer.get(self.sent..).filter(|rest| !rest.is_empty())?;
        // An even number, so that no index of a list is cut in two.
        let data_max = (room - HEADER_BYTES) & !1;
        let data = rest.get(..data_max).unwrap_or(rest);
        let left = rest.len().div_ceil(data_max) - 1;
        let incomplete = if left > 0 { INCOMPLETE } else { 0 };
        let [low, high] = (left as u16).to_le_bytes();
        self.sent += data.len();
        Some(Service::SdoInformation.message(&[&[self.operation | incomplete, 0, low, high], data]))
    }
}

/// Whether an object belongs to a list: all, mappable into RxPDOs, into TxPDOs, kept over power-off, settings for the start.
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
    (0..=object.sub_max()).any(|sub| object.entry(sub).is_some_and(|entry| entry.access.any(wanted)))
}
