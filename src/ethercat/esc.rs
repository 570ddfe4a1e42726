//! What a controller chip must give: access to its registers and memory from the process data interface.

/// An EtherCAT SubDevice controller, as the processor beside it sees it.
///
/// Addresses are those of the ESC's own memory: registers below 1000h, mailboxes and process data from there on. An access has
/// the side effects of the chip: it may clear events, and a SyncManager's buffer changes hands when its last byte is accessed.
pub trait Esc {
    /// Reads `into.len()` bytes from `address` on.
    async fn read(&mut self, address: u16, into: &mut [u8]) -> Result<(), EscError>;

    /// Writes `bytes` from `address` on.
    async fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), EscError>;

    /// The AL event request (register 0220h): why the chip wants attention.
    async fn events(&mut self) -> Result<u32, EscError>;
}

/// Why an access to the chip failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum EscError {
    /// The bus to the chip failed.
    #[error("the bus to the EtherCAT controller failed")]
    Bus,
    /// The chip answers with something else than itself: it is absent, in reset, or the wiring is wrong.
    #[error("no EtherCAT controller answers: {0:#010x} read instead of its test pattern")]
    Absent(u32),
    /// The chip did not finish in the time that it may take.
    #[error("the EtherCAT controller did not finish at {0:#06x}")]
    Stuck(u16),
}
