//! A chip's memory, with numbers in wire order.

/// Registers and process data memory of a chip.
#[derive(Debug, Clone)]
pub(crate) struct Memory(Vec<u8>);

impl Memory {
    pub(crate) fn new(bytes: usize) -> Self {
        Self(vec![0; bytes])
    }

    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    pub(crate) fn byte(&self, address: u16) -> u8 {
        self.0[usize::from(address)]
    }

    pub(crate) fn set_byte(&mut self, address: u16, value: u8) {
        self.0[usize::from(address)] = value;
    }

    pub(crate) fn bytes<const N: usize>(&self, address: u16) -> [u8; N] {
        *self.0[usize::from(address)..].first_chunk().expect("registers are within the memory")
    }

    /// Up to `count` bytes, limited by the end of the memory.
    pub(crate) fn span(&self, address: u16, count: u16) -> &[u8] {
        let start = usize::from(address).min(self.0.len());
        &self.0[start..(start + usize::from(count)).min(self.0.len())]
    }

    pub(crate) fn word(&self, address: u16) -> u16 {
        u16::from_le_bytes(self.bytes(address))
    }

    pub(crate) fn double_word(&self, address: u16) -> u32 {
        u32::from_le_bytes(self.bytes(address))
    }

    pub(crate) fn quad_word(&self, address: u16) -> u64 {
        u64::from_le_bytes(self.bytes(address))
    }

    pub(crate) fn put(&mut self, address: u16, bytes: &[u8]) {
        let start = usize::from(address);
        self.0[start..start + bytes.len()].copy_from_slice(bytes);
    }

    pub(crate) fn clear(&mut self, addresses: std::ops::RangeInclusive<u16>) {
        self.0[usize::from(*addresses.start())..=usize::from(*addresses.end())].fill(0);
    }
}
