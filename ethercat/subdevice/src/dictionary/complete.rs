//! Writes by complete access: all of an object's values, or none.

use super::Dictionary;
use crate::application::{Address, Application};
use crate::catalogue::Catalogue;
use crate::coe::abort::Abort;
use crate::object::{Access, DataType, Entries, Object};

impl<A: Application> Dictionary<'_, A> {
    /// Writes all entries from `first` on: every value is checked before the first is written. A count in the data must match the
    /// object; a list of settings may be shorter, and its remaining entries return to their defaults. (No object mixes entries kept
    /// by the stack, which can still refuse, with other writable ones.)
    pub(super) fn write_complete(&mut self, object: &Object, first: u8, bytes: &[u8]) -> Result<(), Abort> {
        // Bits are packed in a complete access; writing them that way is not supported.
        let is_bit = |sub| object.entry(sub).is_some_and(|entry| entry.data_type == DataType::Bool);
        if (1..=object.sub_max()).any(is_bit) {
            return Err(Abort::NoCompleteAccess);
        }
        let (mut values, mut listed) = (bytes, object.sub_max());
        if first == 0 {
            let (count, rest) = bytes.split_first_chunk::<2>().ok_or(Abort::TooShort)?;
            listed = u8::try_from(u16::from_le_bytes(*count)).unwrap_or(u8::MAX);
            if listed > object.sub_max() || listed < object.sub_max() && !may_be_shorter(object) {
                return Err(Abort::Range);
            }
            values = rest;
        }
        for committing in [false, true] {
            let mut rest = values;
            for sub in 1..=object.sub_max() {
                let Some(entry) = object.entry(sub) else { continue };
                let size = entry.data_type.bytes();
                let default = entry.default_number().unwrap_or_default().to_le_bytes();
                let (value, behind) = match sub <= listed {
                    true => rest.split_at_checked(size).ok_or(Abort::TooShort)?,
                    false => (default.get(..size).ok_or(Abort::General)?, rest),
                };
                rest = behind;
                let entry =
                    if committing { self.writable(object, sub) } else { self.check(object, sub, value) }?;
                if committing {
                    self.commit(entry, Address { index: object.index, sub }, value)?;
                }
            }
            if !rest.is_empty() {
                return Err(Abort::TooLong);
            }
        }
        Ok(())
    }

    /// Writes a PDO assignment as a whole. From sub-index 1 on, the number of values is the count.
    pub(super) fn assign(&mut self, at: Address, bytes: &[u8]) -> Result<(), Abort> {
        let mut values = bytes;
        if at.sub == 0 {
            let (count, rest) = bytes.split_first_chunk::<2>().ok_or(Abort::TooShort)?;
            let listed = 2 * usize::from(u16::from_le_bytes(*count));
            if rest.len() > listed {
                return Err(Abort::TooLong);
            }
            values = rest.get(..listed).ok_or(Abort::TooShort)?;
        }
        let (pdos, []) = values.as_chunks::<2>() else { return Err(Abort::LengthMismatch) };
        let catalogue = Catalogue { device: self.device, application: &*self.application };
        let assignment = self.communication.assignment(at.index).ok_or(Abort::General)?;
        *assignment = assignment.replaced(&catalogue, pdos.iter().map(|pdo| u16::from_le_bytes(*pdo)))?;
        self.tell_assignment(at.index);
        Ok(())
    }
}

/// Whether an object is a list of numeric settings.
fn may_be_shorter(object: &Object) -> bool {
    match object.entries {
        Entries::Array(_, entry) => entry.data_type.is_number() && entry.access.any(Access::SETTING),
        _ => false,
    }
}
