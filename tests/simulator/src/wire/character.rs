//! A character on a wire, and what may be wrong with it.

/// A character's place on the wire, in nanoseconds since the start.
#[derive(Debug, Clone, Copy)]
pub(super) struct Character {
    pub(super) start_ns: u64,
    pub(super) end_ns: u64,
    pub(super) from: usize,
    pub(super) byte: u8,
    pub(super) corrupt: bool,
    pub(super) flaw: Option<Flaw>,
    /// Only the sender hears it: what a receiver with swapped wires makes of a line that falls idle.
    pub(super) own: bool,
}

/// What a receiver notices of a bad character.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flaw {
    /// The parity bit is wrong.
    Parity,
    /// There is no stop bit where one should be.
    Framing,
}
