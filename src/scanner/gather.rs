//! Gathers rows into one frame, and encodes it.
//!
//! The row whose turn it is takes along the marked rows of its device and table with adjacent addresses, first upwards, then
//! downwards, up to the protocol's limit. Rows to be read may overlap; rows to be written may not, since their order matters. A
//! single cell written by function 5 or 6 goes alone, and so do bits of a register.

use super::bits::{bit, copy_bits};
use super::kind::Kind;
use super::register_bits::RegisterBits;
use super::row::{Entry, Row};
use super::station::Device;
use super::status::Status;
use super::values::Values;

pub use crate::modbus::Pdu;
use crate::modbus::pdu::function::{
    MASK_WRITE_REGISTER, WRITE_MULTIPLE_COILS, WRITE_MULTIPLE_REGISTERS, WRITE_SINGLE_COIL,
    WRITE_SINGLE_REGISTER,
};

/// A range of cells in a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Extent {
    pub(super) kind: Kind,
    pub(super) first: u16,
    pub(super) count: u16,
}

impl Extent {
    fn of(row: &Row) -> Self {
        Self { kind: row.kind, first: row.first, count: row.count }
    }

    fn end(&self) -> u32 {
        u32::from(self.first) + u32::from(self.count)
    }

    /// The range extended by the cells of `row`, if they are adjacent and it is not too long.
    fn joined(&self, row: &Row, write: bool, upwards: bool) -> Option<Self> {
        let other = Self::of(row);
        let touches = match (write, upwards) {
            (true, true) => self.end() == u32::from(other.first),
            (true, false) => other.end() == u32::from(self.first),
            (false, true) => other.first >= self.first && u32::from(other.first) <= self.end(),
            (false, false) => other.first < self.first && other.end() >= u32::from(self.first),
        };
        let first = self.first.min(other.first);
        let count = u16::try_from(self.end().max(other.end()) - u32::from(first)).ok()?;
        let fits = touches && count <= self.kind.cells_max(write);
        fits.then_some(Self { first, count, ..*self })
    }
}

/// Whether the row is written by function 5 or 6.
fn is_single(row: &Row) -> bool {
    row.count == 1 && !row.multiple
}

/// Whether it is written alone.
fn is_alone(row: &Row) -> bool {
    is_single(row) || row.register_bits().is_some()
}

/// Marks the rows that share a frame with row `leader` as in progress, and returns the frame's cells. A frame that `repeats` has
/// the same rows as before.
pub(super) fn gather(entries: &mut [Entry], leader: usize, write: bool, repeats: bool) -> Option<Extent> {
    let entry = entries.get_mut(leader)?;
    entry.begin(write);
    let lead = entry.row;
    let mut extent = Extent::of(&lead);
    if write && is_alone(&lead) {
        return Some(extent);
    }
    let marked = if write { Status::WRITE_MARKED } else { Status::READ_MARKED };
    for upwards in [true, false] {
        // Terminates: every round takes a row.
        while let Some((entry, joined)) = entries.iter_mut().find_map(|entry| {
            let Entry { row, status, .. } = &entry;
            let eligible = row.device == lead.device
                && row.kind == lead.kind
                && status.any(marked)
                && !status.any(Status::WRITE_BLOCKED)
                && (entry.repeats || !repeats)
                && !(write && is_alone(row));
            let joined = extent.joined(row, write, upwards).filter(|_| eligible)?;
            Some((entry, joined))
        }) {
            entry.begin(write);
            extent = joined;
        }
    }
    Some(extent)
}

/// The request that reads `extent`.
pub(super) fn read_request(extent: Extent) -> Pdu {
    let mut pdu = Pdu::new();
    // Five bytes.
    let _ = pdu.push(extent.kind.read_function());
    let _ = pdu.extend_from_slice(&extent.first.to_be_bytes());
    let _ = pdu.extend_from_slice(&extent.count.to_be_bytes());
    pdu
}

/// The request that writes `extent`, from the rows of `entries` in progress for the device of `row`.
pub(super) fn write_request(
    entries: &[Entry],
    lead: &Row,
    extent: Extent,
    values: &Values,
    device: &Device,
) -> Pdu {
    let mut pdu = Pdu::new();
    let bits = extent.kind.is_bits();
    let bytes = extent.kind.bytes(extent.count);
    // Everything pushed here and below fits: the extent is within the protocol's limits.
    if is_single(lead) {
        let value = values.span(lead.output, bytes);
        let _ = pdu.push(if bits { WRITE_SINGLE_COIL } else { WRITE_SINGLE_REGISTER });
        let _ = pdu.extend_from_slice(&extent.first.to_be_bytes());
        let coil = [if bit(value, 0) { 0xff } else { 0 }, 0];
        let _ = pdu.extend_from_slice(if bits { &coil } else { value });
        return pdu;
    }
    let _ = pdu.push(if bits { WRITE_MULTIPLE_COILS } else { WRITE_MULTIPLE_REGISTERS });
    let _ = pdu.extend_from_slice(&extent.first.to_be_bytes());
    let _ = pdu.extend_from_slice(&extent.count.to_be_bytes());
    let _ = pdu.push(bytes as u8);
    let data = pdu.len();
    let _ = pdu.resize(data + usize::from(bytes), 0);
    let data = pdu.get_mut(data..).unwrap_or_default();
    let in_progress =
        |entry: &&Entry| entry.row.device == lead.device && entry.status.any(Status::IN_PROGRESS);
    for Entry { row, .. } in entries.iter().filter(in_progress) {
        let at = usize::from(row.first - extent.first);
        let mut own = Pdu::from_slice(values.span(row.output, row.bytes())).unwrap_or_default();
        row.form.turn(device.order, &mut own);
        if bits {
            copy_bits(&own, 0, data, at, usize::from(row.count));
        } else if let Some(place) = data.get_mut(2 * at..2 * at + own.len()) {
            place.copy_from_slice(&own);
        }
    }
    pdu
}

/// The request that sets and clears `bits` in the register of `lead`, as in the variable (function 22).
pub(super) fn mask_request(lead: &Row, bits: RegisterBits, values: &Values) -> Pdu {
    let mut pdu = Pdu::new();
    let keeps = !bits.mask();
    // Seven bytes (Application Protocol 6.16).
    let _ = pdu.push(MASK_WRITE_REGISTER);
    for field in [lead.first, keeps, bits.put(0, values.span(lead.output, lead.bytes()))] {
        let _ = pdu.extend_from_slice(&field.to_be_bytes());
    }
    pdu
}

/// The request that writes the register of `lead`, as read before, with `bits` as in the variable.
pub(super) fn store_request(lead: &Row, bits: RegisterBits, register: u16, values: &Values) -> Pdu {
    let mut pdu = Pdu::new();
    let register = bits.put(register, values.span(lead.output, lead.bytes())).to_be_bytes();
    let [first, first_low] = lead.first.to_be_bytes();
    // Eight bytes at most.
    let _ = match lead.multiple {
        false => pdu.extend_from_slice(&[WRITE_SINGLE_REGISTER, first, first_low]),
        true => pdu.extend_from_slice(&[WRITE_MULTIPLE_REGISTERS, first, first_low, 0, 1, 2]),
    };
    let _ = pdu.extend_from_slice(&register);
    pdu
}

/// Copies the cells of `row` from the response to a read from `first` on.
pub(super) fn take_cells(row: &Row, first: u16, response: &[u8], device: &Device, into: &mut [u8]) {
    let data = response.get(2..).unwrap_or_default();
    let at = usize::from(row.first.saturating_sub(first));
    if row.kind.is_bits() {
        // Unused bits stay 0.
        copy_bits(data, at, into, 0, usize::from(row.count));
    } else if let (Some(bits), Some(register)) = (row.register_bits(), register(data, at)) {
        bits.take(register, into);
    } else if let Some(own) = data.get(2 * at..2 * at + into.len()) {
        into.copy_from_slice(own);
    }
    row.form.turn(device.order, into);
}

/// Register `at` of `data`.
pub(super) fn register(data: &[u8], at: usize) -> Option<u16> {
    data.as_chunks().0.get(at).map(|register| u16::from_be_bytes(*register))
}
