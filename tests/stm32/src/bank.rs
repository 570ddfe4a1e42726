//! Registers that keep what is written to them. Some of their bits follow others, as "ready" follows "on".

use std::collections::BTreeMap;

/// One register of a table: its offset, its value after a reset, and the bits that a program can change.
pub(crate) type Row = (u32, u32, u32);

/// All bits can be changed.
pub(crate) const ALL: u32 = u32::MAX;

/// A peripheral's plain registers, by their offsets.
#[derive(Clone, Default)]
pub(crate) struct Bank(BTreeMap<u32, Register>);

#[derive(Clone, Copy)]
struct Register {
    value: u32,
    writable: u32,
}

impl Bank {
    pub(crate) fn new(rows: &[Row]) -> Self {
        Self(rows.iter().map(|&(offset, value, writable)| (offset, Register { value, writable })).collect())
    }

    /// The register at `offset`, if the table has it.
    pub(crate) fn read(&self, offset: u32) -> Option<u32> {
        self.0.get(&offset).map(|register| register.value)
    }

    /// Writes those bits that a program can change.
    pub(crate) fn write(&mut self, offset: u32, value: u32) -> Option<()> {
        let register = self.0.get_mut(&offset)?;
        register.value = register.value & !register.writable | value & register.writable;
        Some(())
    }

    /// The register at `offset`, which is in the table.
    pub(crate) fn get(&self, offset: u32) -> u32 {
        self.0[&offset].value
    }

    /// Sets the register at `offset` as the hardware does.
    pub(crate) fn set(&mut self, offset: u32, value: u32) {
        if let Some(register) = self.0.get_mut(&offset) {
            register.value = value;
        }
    }

    /// Makes bits follow others of the same register: (register, leader, follower).
    pub(crate) fn follow(&mut self, pairs: &[(u32, u32, u32)]) {
        for &(offset, leader, follower) in pairs {
            let value = self.get(offset);
            let bit = value >> leader & 1;
            self.set(offset, value & !(1 << follower) | bit << follower);
        }
    }
}

/// Bits `low..low + count` of `value`.
pub(crate) fn bits(value: u32, low: u32, count: u32) -> u32 {
    value >> low & ((1 << count) - 1)
}
