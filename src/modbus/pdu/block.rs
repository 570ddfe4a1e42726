//! Blocks of neighbouring coils, inputs or registers: combines several reads into one, and extracts the response to each.

use core::num::NonZeroU8;

use super::Extent;
use super::function::{Cells, Form};
use crate::modbus::PDU_BYTES_MAX;

/// The block read by functions 1 to 4.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Block {
    // Makes `Option<Block>` as small as a block.
    function: NonZeroU8,
    first: u16,
    /// Not below `first`.
    last: u16,
}

impl Block {
    /// The block read by `request`, if it is such a read with a valid quantity that does not wrap around the last address.
    pub fn of(request: &[u8]) -> Option<Self> {
        let &[function, a, b, c, d] = request else { return None };
        let (first, quantity) = (u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d]));
        let function = NonZeroU8::new(function)?;
        Self { function, first, last: first.checked_add(quantity.checked_sub(1)?)? }.if_readable()
    }

    /// The request that reads this block.
    pub fn request(&self) -> [u8; 5] {
        let ([a, b], [c, d]) = (self.first.to_be_bytes(), self.quantity().to_be_bytes());
        [self.function.get(), a, b, c, d]
    }

    /// Its addresses.
    pub fn extent(&self) -> Extent {
        Extent { write: false, first: self.first, last: self.last.into() }
    }

    /// Number of addresses between this block and `other`; 0 if they touch or overlap.
    pub fn distance(&self, other: &Self) -> u16 {
        let (low, high) = if self.first <= other.first { (self, other) } else { (other, self) };
        high.first.saturating_sub(low.last).saturating_sub(1)
    }

    /// The smallest block that covers both, if they have the same function and a single request can read it.
    pub fn hull(&self, other: &Self) -> Option<Self> {
        let (first, last) = (self.first.min(other.first), self.last.max(other.last));
        if self.function == other.function { Self { first, last, ..*self }.if_readable() } else { None }
    }

    /// The response to `wanted`, extracted from `response` to this block. `None` if `wanted` is not a part of the block, or
    /// `response` is an exception.
    pub fn part<'a>(
        &self,
        response: &[u8],
        wanted: &Self,
        out: &'a mut [u8; PDU_BYTES_MAX],
    ) -> Option<&'a [u8]> {
        let offset = usize::from(wanted.first.checked_sub(self.first)?);
        let &[function, _, ref data @ ..] = response else { return None };
        if self.hull(wanted)? != *self || function != self.function.get() {
            return None;
        }
        let cells = self.cells()?;
        let bytes = cells.bytes(wanted.quantity());
        out[..2].copy_from_slice(&[function, bytes as u8]);
        let part = out.get_mut(2..2 + bytes)?;
        if cells.bits == 1 {
            copy_bits(data.get(offset / 8..)?, offset % 8, wanted.quantity().into(), part);
        } else {
            part.copy_from_slice(data.get(2 * offset..2 * offset + bytes)?);
        }
        out.get(..2 + bytes)
    }

    fn if_readable(self) -> Option<Self> {
        (self.last - self.first < self.cells()?.most).then_some(self)
    }

    fn quantity(&self) -> u16 {
        // At most 2000.
        self.last - self.first + 1
    }

    /// The cells that it reads; `None` for functions other than reads.
    fn cells(&self) -> Option<Cells> {
        match Form::of(&[self.function.get()])? {
            Form::Read(cells) => Some(cells),
            _ => None,
        }
    }
}

/// Copies `count` bits of `data`, starting at bit `shift` of its first byte; the rest of the last byte is zero (clause 6.1).
fn copy_bits(data: &[u8], shift: usize, count: usize, out: &mut [u8]) {
    for (at, out) in out.iter_mut().enumerate() {
        let byte = |at: usize| u16::from(data.get(at).copied().unwrap_or(0));
        *out = ((byte(at + 1) << 8 | byte(at)) >> shift) as u8;
    }
    if let (Some(last), used @ 1..) = (out.last_mut(), count % 8) {
        *last &= (1 << used) - 1;
    }
}
