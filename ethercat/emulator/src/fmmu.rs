//! FMMUs: the bitwise mapping of logical addresses to a chip's memory (I, FMMU; II, 0600h to 06FFh).

use crate::memory::Memory;
use crate::registers::FMMU;

/// Registers of one FMMU.
pub const BYTES: u16 = 16;

/// An FMMU's register settings, in bits.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fmmu {
    /// The first mapped bit in the logical space.
    logical: u64,
    bits: u64,
    /// The first mapped bit in the chip's memory.
    physical: u64,
    pub(crate) reads: bool,
    pub(crate) writes: bool,
}

/// A byte of the chip's memory and the bits of it covered by a datagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Mapped {
    pub(crate) address: u16,
    /// Bits of the byte.
    pub(crate) mask: u8,
    /// Position of the byte's bit 0 in the datagram's data, in bits; negative if outside.
    pub(crate) bit: i64,
}

impl Fmmu {
    /// FMMU number `nth`, if active.
    pub(crate) fn of(memory: &Memory, nth: usize) -> Option<Self> {
        let base = FMMU + BYTES * nth as u16;
        if memory.byte(base + 12) & 1 == 0 {
            return None;
        }
        let length = u64::from(memory.word(base + 4));
        let [first_bit, last_bit] = memory.bytes(base + 6).map(|bit: u8| u64::from(bit & 7));
        let kind = memory.byte(base + 11);
        Some(Self {
            logical: u64::from(memory.double_word(base)) * 8 + first_bit,
            bits: (length * 8).saturating_sub(first_bit + 7 - last_bit),
            physical: u64::from(memory.word(base + 8)) * 8 + u64::from(memory.byte(base + 10) & 7),
            reads: kind & 1 != 0,
            writes: kind & 2 != 0,
        })
    }

    /// The mapping of a datagram of `bytes` at `logical`, if it is byte-aligned: first address, position in the datagram, and
    /// count.
    pub(crate) fn mapped_bytes(self, logical: u32, bytes: usize) -> Option<(u64, usize, usize)> {
        if [self.logical, self.bits, self.physical].iter().any(|bits| bits % 8 != 0) {
            return None;
        }
        let (own, datagram) = (self.logical / 8, u64::from(logical));
        let first = own.max(datagram);
        let last = (own + self.bits / 8).min(datagram + bytes as u64);
        let count = last.checked_sub(first)?;
        Some((self.physical / 8 + first - own, (first - datagram) as usize, count as usize))
    }

    /// The bytes of memory covered by a datagram of `bytes` at `logical`, in address order.
    pub(crate) fn mapped(self, logical: u32, bytes: usize) -> impl Iterator<Item = Mapped> {
        let datagram = u64::from(logical) * 8;
        let first = self.logical.max(datagram);
        let last = (self.logical + self.bits).min(datagram + bytes as u64 * 8);
        let physical = |bit: u64| bit - self.logical + self.physical;
        let reached = if first < last { physical(first)..physical(last) } else { 0..0 };
        // Addresses beyond the memory are not mapped.
        let end = reached.end.div_ceil(8).min(1 << 16);
        (reached.start / 8..end).map(move |address| {
            let from = reached.start.saturating_sub(address * 8);
            let missing = (address * 8 + 8).saturating_sub(reached.end);
            let mask = 0xFFu8 << from & 0xFF >> missing;
            let bit = (address * 8 + self.logical) as i64 - (self.physical + datagram) as i64;
            Mapped { address: address as u16, mask, bit }
        })
    }
}

impl Mapped {
    /// Extracts the byte's bits from `data`.
    pub(crate) fn take(self, data: &[u8]) -> u8 {
        if self.is_whole() {
            return data[(self.bit / 8) as usize];
        }
        self.positions().fold(0, |byte, (bit, at)| byte | (data[at / 8] >> (at % 8) & 1) << bit)
    }

    /// Puts the byte's bits into `data`.
    pub(crate) fn put(self, byte: u8, data: &mut [u8]) {
        if self.is_whole() {
            data[(self.bit / 8) as usize] = byte;
            return;
        }
        for (bit, at) in self.positions() {
            let place = &mut data[at / 8];
            *place = *place & !(1 << (at % 8)) | (byte >> bit & 1) << (at % 8);
        }
    }

    fn is_whole(self) -> bool {
        self.mask == 0xFF && self.bit % 8 == 0
    }

    /// The mapped bits of the byte, each with its position in the data.
    fn positions(self) -> impl Iterator<Item = (u8, usize)> {
        (0..8)
            .filter(move |bit| self.mask >> bit & 1 != 0)
            .map(move |bit| (bit, (self.bit + i64::from(bit)) as usize))
    }
}
