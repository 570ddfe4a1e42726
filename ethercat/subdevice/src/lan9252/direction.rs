//! What is known of an engine that moves process data in one direction.

/// One of the two engines.
#[derive(Debug, Clone, Copy)]
pub(super) struct Direction {
    /// Where its FIFO is.
    pub(super) port: u16,
    /// Its address and length register; the command register is right behind.
    pub(super) place: u16,
    /// A transfer is under way: its future was dropped, or it failed.
    pub(super) open: bool,
    /// So many transfers in a row were not finished in time.
    pub(super) stuck: u8,
    /// Whether the level of the FIFO must be watched.
    pub(super) watched: bool,
}

impl Direction {
    pub(super) const READ: Self = Self { port: 0x000, place: 0x308, open: false, stuck: 0, watched: true };
    pub(super) const WRITE: Self = Self { port: 0x020, place: 0x310, open: false, stuck: 0, watched: true };

    pub(super) fn command(self) -> u16 {
        self.place + 4
    }
}
