//! The rows without a device, as tables of one unit that outside clients read and write.
//!
//! A request is executed if each of its cells belongs to such a row, and gets 02 otherwise. The variable of a polled point can be
//! written if the point is written automatically, if nothing else would overwrite the value first, or in a safe write. A row may
//! have two more input registers: its status word, and the age of its values in tenths of a second.

use embassy_time::{Duration, Instant};

use super::Scanner;
use super::bits::copy_bits;
use super::gather::Pdu;
use super::kind::Kind;
use super::row::{Entry, Reading, RowId, Writing};
use super::status::Status;
use crate::modbus::pdu::function::{WRITE_SINGLE_COIL, WRITE_SINGLE_REGISTER};
use crate::modbus::{Exception, PDU_BYTES_MAX};

/// Registers of a row's quality: status word and age.
pub(crate) const QUALITY_REGISTERS: u16 = 2;
/// The age register, in tenths of a second, of values older than it can show, or never read.
const AGE_MAX: u64 = 65_535;

/// The register that shows an age; `None`: never.
pub(crate) fn age_register(age: Option<Duration>) -> u16 {
    age.map_or(AGE_MAX, |age| (age.as_millis() / 100).min(AGE_MAX)) as u16
}

/// The cells of a request.
struct Cells {
    kind: Kind,
    first: u16,
    count: u16,
}

/// The part of them in one row.
struct Part {
    row: RowId,
    /// The first cell, within the row and within the request.
    in_row: u16,
    in_request: u16,
    count: u16,
}

impl Scanner {
    /// Whether any rows are visible to outside clients.
    pub fn serves(&self) -> bool {
        self.entries.iter().any(|entry| entry.row.device.is_none())
    }

    /// Executes `request`, which has passed [`check_request`](crate::modbus::pdu::check_request); functions other than 1 to 6, 15
    /// and 16 get 01.
    pub fn serve(&mut self, request: &[u8], now: Instant) -> Result<Pdu, Exception> {
        let &[function, a, b, c, d, ref rest @ ..] = request else { return Err(Exception::ILLEGAL_FUNCTION) };
        let Some((kind, write)) = Kind::of_function(function) else {
            return Err(Exception::ILLEGAL_FUNCTION);
        };
        let (first, second) = (u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d]));
        let single = matches!(function, WRITE_SINGLE_COIL | WRITE_SINGLE_REGISTER);
        let cells = Cells { kind, first, count: if single { 1 } else { second } };
        if !write {
            return self.serve_read(function, &cells, now);
        }
        let coil = [u8::from(c != 0)];
        let data = match (function, rest) {
            (WRITE_SINGLE_COIL, _) => &coil[..],
            (WRITE_SINGLE_REGISTER, _) => request.get(3..5).unwrap_or_default(),
            // After the byte count.
            (_, [_, data @ ..]) => data,
            _ => return Err(Exception::ILLEGAL_VALUE),
        };
        self.serve_write(&cells, data, now)?;
        // The response repeats address and value or quantity (clauses 6.5, 6.6, 6.11, 6.12).
        Pdu::from_slice(request.get(..5).unwrap_or_default()).map_err(|_| Exception::DEVICE_FAILURE)
    }

    fn serve_read(&self, function: u8, cells: &Cells, now: Instant) -> Result<Pdu, Exception> {
        let bytes = usize::from(cells.kind.bytes(cells.count));
        let mut response = Pdu::from_slice(&[function, bytes as u8]).unwrap_or_default();
        if bytes > PDU_BYTES_MAX - response.len() {
            return Err(Exception::ILLEGAL_VALUE);
        }
        // There is room, see above.
        let _ = response.resize(2 + bytes, 0);
        let data = response.get_mut(2..).unwrap_or_default();
        let mut at = 0;
        while at < cells.count {
            if let Some(register) = self.quality_register(cells, at, now) {
                if let Some(place) = data.get_mut(2 * usize::from(at)..2 * usize::from(at) + 2) {
                    place.copy_from_slice(&register.to_be_bytes());
                }
                at += 1;
                continue;
            }
            let part = self.part(cells, at).ok_or(Exception::ILLEGAL_ADDRESS)?;
            copy_cells(cells.kind, (self.input(part.row), part.in_row), (data, at), part.count);
            at += part.count;
        }
        Ok(response)
    }

    fn serve_write(&mut self, cells: &Cells, data: &[u8], now: Instant) -> Result<(), Exception> {
        // All or nothing.
        let mut at = 0;
        while at < cells.count {
            let part = self.part(cells, at).filter(|part| self.is_open(part.row));
            let part = part.ok_or(Exception::ILLEGAL_ADDRESS)?;
            if !self.holds(&part, data) {
                return Err(Exception::ILLEGAL_VALUE);
            }
            at += part.count;
        }
        let mut at = 0;
        while let Some(part) = self.part(cells, at).filter(|_| at < cells.count) {
            let mut own = [0; PDU_BYTES_MAX];
            copy_cells(cells.kind, (data, part.in_request), (&mut own, 0), part.count);
            let put = self.put(part.row, part.in_row, part.count, &own, now);
            put.map_err(|_| Exception::ILLEGAL_ADDRESS)?;
            at += part.count;
        }
        Ok(())
    }

    /// The part of the cells from `at` on that is in one row.
    fn part(&self, cells: &Cells, at: u16) -> Option<Part> {
        let address = u32::from(cells.first) + u32::from(at);
        let has = |entry: &Entry| {
            let row = &entry.row;
            row.device.is_none()
                && row.kind == cells.kind
                && (u32::from(row.first)..row.end()).contains(&address)
        };
        let place = self.entries.iter().position(has)?;
        let row = self.entries.get(place)?.row;
        let in_row = (address - u32::from(row.first)) as u16;
        let count = (row.count - in_row).min(cells.count - at);
        Some(Part { row: RowId(place as u8), in_row, in_request: at, count })
    }

    /// The status word or age of a row, if there is such a register at `at`.
    fn quality_register(&self, cells: &Cells, at: u16, now: Instant) -> Option<u16> {
        let address = cells.first.checked_add(at).filter(|_| cells.kind == Kind::Input)?;
        let of = |entry: &Entry| {
            Some(address.checked_sub(entry.row.quality?)?).filter(|nth| *nth < QUALITY_REGISTERS)
        };
        let (row, nth) = self.entries.iter().enumerate().find_map(|(row, entry)| Some((row, of(entry)?)))?;
        let row = RowId(row as u8);
        Some(match nth {
            0 => self.status(row, now).bits(),
            _ => age_register(self.age(row, now)),
        })
    }

    /// Whether the row has as many bits as its part of the request.
    fn holds(&self, part: &Part, data: &[u8]) -> bool {
        let bits = self.variable(part.row).and_then(|entry| entry.row.register_bits());
        bits.is_none_or(|bits| bits.hold(data.get(2 * usize::from(part.in_request)..).unwrap_or_default()))
    }

    /// Whether outside clients may write the row.
    fn is_open(&self, id: RowId) -> bool {
        self.variable(id).is_some_and(|Entry { row, status, .. }| match row.write {
            _ if row.device.is_none() => true,
            Writing::Auto | Writing::OnChange | Writing::Every(_) => true,
            Writing::Manual => row.read == Reading::Manual || status.any(Status::WRITE_BLOCKED),
            Writing::Never => false,
        })
    }
}

/// Copies `count` cells; indexes are in cells.
fn copy_cells(kind: Kind, from: (&[u8], u16), to: (&mut [u8], u16), count: u16) {
    let [from_at, to_at, count] = [from.1, to.1, count].map(usize::from);
    if kind.is_bits() {
        return copy_bits(from.0, from_at, to.0, to_at, count);
    }
    let source = from.0.get(2 * from_at..2 * (from_at + count));
    if let (Some(source), Some(place)) = (source, to.0.get_mut(2 * to_at..2 * (to_at + count))) {
        place.copy_from_slice(source);
    }
}
