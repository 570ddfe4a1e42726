//! Access to the dictionary's values, with all checks that SDO requires: existence, rights, state, length, range.

mod complete;

use heapless::Vec;

use crate::al_state::AlState;
use crate::application::{Address, Application};
use crate::catalogue::Catalogue;
use crate::coe::abort::Abort;
use crate::communication::Communication;
use crate::device::Device;
use crate::object::{Access, DataType, Entries, Entry, Object, PDOS_SELECTED_MAX, Value};

/// Most bytes of an object, also in a complete access: a buffer of 512 bytes, and its count.
pub const OBJECT_BYTES_MAX: usize = 520;

/// An object's value or values.
pub type Bytes = Vec<u8, OBJECT_BYTES_MAX>;

/// The dictionary with the state that access depends on.
pub struct Dictionary<'a, A> {
    /// The table.
    pub device: &'static Device,
    /// The stack's values.
    pub communication: &'a mut Communication,
    /// The source of all other values.
    pub application: &'a mut A,
    /// The state, which determines rights.
    pub state: AlState,
}

/// The target of an SDO.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Target {
    /// The entry.
    pub at: Address,
    /// Whether all entries from sub-index 0 or 1 on are meant.
    pub complete: bool,
}

impl<A: Application> Dictionary<'_, A> {
    /// Reads `target`.
    pub fn read(&mut self, target: Target) -> Result<Bytes, Abort> {
        let mut bytes = Bytes::new();
        let Target { at, complete } = target;
        let object = self.object(at.index)?;
        if !complete {
            self.read_entry(&object, at.sub, &mut bytes)?;
            return Ok(bytes);
        }
        let mut last = object.sub_max();
        check_complete(&object, at.sub)?;
        if let Some(assignment) = self.communication.assignment(at.index) {
            last = assignment.value(0) as u8;
        }
        let mut bits = 0;
        for sub in (at.sub..=last).filter(|sub| object.entry(*sub).is_some()) {
            let start = bytes.len();
            self.read_entry(&object, sub, &mut bytes)?;
            if sub == 0 {
                // The count takes 16 bits in a complete access (ETG.1000.6, clause 5.6.2).
                bytes.push(0).map_err(|_| Abort::OutOfMemory)?;
            } else if object.entry(sub).is_some_and(|entry| entry.data_type == DataType::Bool) {
                pack_bit(&mut bytes, start, bits);
                bits += 1;
            } else {
                bits = 0;
            }
        }
        Ok(bytes)
    }

    /// Checks whether `target` is writable at all, before its data have arrived.
    pub fn check_writable(&self, target: Target) -> Result<(), Abort> {
        let Target { at, complete } = target;
        let object = self.object(at.index)?;
        if !complete {
            return self.writable(&object, at.sub).map(|_| ());
        }
        check_complete(&object, at.sub)?;
        let counted = u8::from(!matches!(object.entries, Entries::Assignment(..)));
        let mut subs = (at.sub.max(counted)..=object.sub_max()).filter(|sub| object.entry(*sub).is_some());
        subs.try_for_each(|sub| self.writable(&object, sub).map(|_| ()))
    }

    /// Writes all of `bytes`, or nothing.
    pub fn write(&mut self, target: Target, bytes: &[u8]) -> Result<(), Abort> {
        self.check_writable(target)?;
        let Target { at, complete } = target;
        let object = self.object(at.index)?;
        match object.entries {
            _ if !complete => {
                let entry = self.check(&object, at.sub, bytes)?;
                self.commit(entry, at, bytes)
            }
            Entries::Assignment(..) => self.assign(at, bytes),
            _ => self.write_complete(&object, at.sub, bytes),
        }
    }

    /// The size of the entry at `at`, or 0.
    pub fn entry_bytes(&self, at: Address) -> usize {
        let entry = self.catalogue().object(at.index).and_then(|object| object.entry(at.sub));
        entry.map_or(0, |entry| entry.data_type.bytes())
    }

    /// All available objects.
    pub fn catalogue(&self) -> Catalogue<'_, A> {
        Catalogue { device: self.device, application: self.application }
    }

    fn object(&self, index: u16) -> Result<Object, Abort> {
        self.catalogue().object(index).ok_or(Abort::NoObject)
    }

    fn read_entry(&mut self, object: &Object, sub: u8, into: &mut Bytes) -> Result<(), Abort> {
        let entry = object.entry(sub).ok_or(Abort::NoEntry)?;
        if !entry.access.any(Access::READ) {
            return Err(Abort::WriteOnly);
        }
        if !entry.access.any(right(Access::READ, self.state)) {
            return Err(Abort::State);
        }
        let start = into.len();
        into.resize(start + entry.data_type.bytes(), 0).map_err(|_| Abort::OutOfMemory)?;
        let place = into.get_mut(start..).unwrap_or_default();
        let at = Address { index: object.index, sub };
        let length = match entry.value {
            Value::Number(number) => put(number.into(), place),
            Value::Text(text) => {
                place.copy_from_slice(text.as_bytes());
                place.len()
            }
            Value::Stack(_) | Value::Computed => {
                let number = self.communication.value(at.index, sub).ok_or(Abort::General)?;
                put(number.into(), place)
            }
            Value::Application(_) => self.application.read(at, place)?,
        };
        into.truncate(start + length);
        Ok(())
    }

    fn writable(&self, object: &Object, sub: u8) -> Result<Entry, Abort> {
        let entry = object.entry(sub).ok_or(Abort::NoEntry)?;
        if !entry.access.any(Access::WRITE) {
            return Err(Abort::ReadOnly);
        }
        if !entry.access.any(right(Access::WRITE, self.state)) {
            return Err(Abort::State);
        }
        Ok(entry)
    }

    /// Whether `bytes` may be written at `sub`.
    fn check(&mut self, object: &Object, sub: u8, bytes: &[u8]) -> Result<Entry, Abort> {
        let entry = self.writable(object, sub)?;
        let size = entry.data_type.bytes();
        if bytes.len() > size {
            return Err(Abort::TooLong);
        }
        if bytes.len() < size && !entry.data_type.may_be_shorter() {
            return Err(Abort::TooShort);
        }
        if entry.data_type.is_number() {
            let number = number(bytes);
            if number < entry.range.0.into() {
                return Err(Abort::TooSmall);
            }
            if number > entry.greatest() {
                return Err(Abort::TooGreat);
            }
        }
        if matches!(entry.value, Value::Application(_)) {
            self.application.check(Address { index: object.index, sub }, bytes)?;
        }
        Ok(entry)
    }

    /// Reports the assigned PDOs to the application if the object `index` is an assignment.
    fn tell_assignment(&mut self, index: u16) {
        if let Some(assignment) = self.communication.assignment(index) {
            let pdos: Vec<u16, PDOS_SELECTED_MAX> = assignment.indices().take(PDOS_SELECTED_MAX).collect();
            self.application.assigned(assignment.channel(), &pdos);
        }
    }

    fn commit(&mut self, entry: Entry, at: Address, bytes: &[u8]) -> Result<(), Abort> {
        match entry.value {
            Value::Stack(_) => {
                let number = u16::try_from(number(bytes)).map_err(|_| Abort::TooGreat)?;
                let catalogue = Catalogue { device: self.device, application: &*self.application };
                self.communication.set(&catalogue, at.index, at.sub, number)?;
                self.tell_assignment(at.index);
                Ok(())
            }
            Value::Application(_) => {
                self.application.write(at, bytes);
                self.communication.follow(self.application);
                Ok(())
            }
            Value::Number(_) | Value::Text(_) | Value::Computed => Err(Abort::ReadOnly),
        }
    }
}

/// Packs the last bit read, at `start`, after the `bits` before it, eight per byte.
fn pack_bit(bytes: &mut Bytes, start: usize, bits: usize) {
    if let (true, Some(bit)) = (!bits.is_multiple_of(8), bytes.get(start).copied()) {
        bytes.truncate(start);
        if let Some(packed) = bytes.last_mut() {
            *packed |= (bit & 1) << (bits % 8);
        }
    }
}

/// Complete access starts at sub-index 0 or 1, and is for objects that have more than one value.
fn check_complete(object: &Object, sub: u8) -> Result<(), Abort> {
    match (object.entries, sub) {
        (Entries::Variable(_), _) => Err(Abort::NoCompleteAccess),
        // The start of the next entry would be unknown.
        (Entries::Record(entries), _) if entries.iter().any(|entry| entry.data_type.may_be_shorter()) => {
            Err(Abort::NoCompleteAccess)
        }
        (_, 0 | 1) => Ok(()),
        _ => Err(Abort::UnsupportedAccess),
    }
}

/// The bit of `rights` for `state`.
fn right(rights: Access, state: AlState) -> Access {
    let lowest = rights.0 & rights.0.wrapping_neg();
    Access(match state {
        AlState::Init | AlState::Boot => 0,
        AlState::PreOp => lowest,
        AlState::SafeOp => lowest << 1,
        AlState::Op => lowest << 2,
    })
}

fn put(number: u64, into: &mut [u8]) -> usize {
    into.iter_mut().zip(number.to_le_bytes()).for_each(|(place, byte)| *place = byte);
    into.len()
}

/// Decodes up to eight bytes.
pub fn number(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |number, &byte| number << 8 | u64::from(byte))
}
