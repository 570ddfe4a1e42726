//! The order of a value's bytes in two registers.

/// The order in which a device sends the four bytes of a 32-bit value; byte 0 is the highest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ByteOrder {
    /// High word first, high byte first.
    #[default]
    Order0123,
    /// Low word first, high byte first.
    Order2301,
    /// High word first, low byte first.
    Order1032,
    /// Low word first, low byte first.
    Order3210,
}

impl ByteOrder {
    /// Converts 32-bit values from a device's order to 0123, or back: each order is its own inverse.
    pub fn turn(self, values: &mut [u8]) {
        for value in values.as_chunks_mut::<4>().0 {
            let [a, b, c, d] = *value;
            *value = match self {
                Self::Order0123 => [a, b, c, d],
                Self::Order2301 => [c, d, a, b],
                Self::Order1032 => [b, a, d, c],
                Self::Order3210 => [d, c, b, a],
            };
        }
    }
}
