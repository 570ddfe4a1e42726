//! Registers that keep what is written to them. Some of their bits follow others, as "ready" follows "on".

/// One register of a table: its offset, its value after a reset, and the bits that a program can change.
pub(crate) type Row = (u32, u32, u32);

const WORD_BYTES: u32 = 4;

/// All bits can be changed.
pub(crate) const ALL: u32 = u32::MAX;

/// A peripheral's plain registers, by the words of their offsets: most of them are looked at after each access to any peripheral.
#[derive(Clone, Default)]
pub(crate) struct Bank(Vec<Option<Register>>);

#[derive(Clone, Copy)]
struct Register {
    value: u32,
    writable: u32,
}

impl Bank {
    pub(crate) fn new(rows: &[Row]) -> Self {
        let end = rows.iter().map(|&(offset, ..)| place(offset) + 1).max().unwrap_or(0);
        let mut registers = vec![None; end];
        for &(offset, value, writable) in rows {
            registers[place(offset)] = Some(Register { value, writable });
        }
        Self(registers)
    }

    fn register(&mut self, offset: u32) -> Option<&mut Register> {
        self.0.get_mut(place(offset)).filter(|_| offset.is_multiple_of(WORD_BYTES))?.as_mut()
    }

    /// The register at `offset`, if the table has it.
    pub(crate) fn read(&self, offset: u32) -> Option<u32> {
        let register = self.0.get(place(offset)).filter(|_| offset.is_multiple_of(WORD_BYTES))?;
        register.map(|register| register.value)
    }

    /// Writes those bits that a program can change.
    pub(crate) fn write(&mut self, offset: u32, value: u32) -> Option<()> {
        let register = self.register(offset)?;
        register.value = register.value & !register.writable | value & register.writable;
        Some(())
    }

    /// The register at `offset`, which is in the table.
    pub(crate) fn get(&self, offset: u32) -> u32 {
        self.0[place(offset)].map_or(0, |register| register.value)
    }

    /// Sets the register at `offset` as the hardware does.
    pub(crate) fn set(&mut self, offset: u32, value: u32) {
        if let Some(register) = self.register(offset) {
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

fn place(offset: u32) -> usize {
    (offset / WORD_BYTES) as usize
}

/// Bits `low..low + count` of `value`.
pub(crate) fn bits(value: u32, low: u32, count: u32) -> u32 {
    value >> low & ((1 << count) - 1)
}
