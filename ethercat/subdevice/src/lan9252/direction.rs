//! The state of an engine that moves process data in one direction.

/// One of the two engines.
#[derive(Debug, Clone, Copy)]
pub(super) struct Direction {
    /// Address of its FIFO.
    pub(super) port: u16,
    /// Its address and length register; the command register follows.
    pub(super) place: u16,
    /// A transfer is unfinished: its future was dropped, or it failed.
    pub(super) open: bool,
    /// Number of successive transfers that timed out.
    pub(super) stuck: u8,
    /// Whether the FIFO's level must be polled.
    pub(super) watched: bool,
}

impl Direction {
    pub(super) const READ: Self = Self { port: 0x000, place: 0x308, open: false, stuck: 0, watched: true };
    pub(super) const WRITE: Self = Self { port: 0x020, place: 0x310, open: false, stuck: 0, watched: true };

    pub(super) fn command(self) -> u16 {
        self.place + 4
    }
}
