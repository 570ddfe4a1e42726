//! What a controller chip must give: access to its registers and memory from the process data interface.

use crc::{CRC_32_ISO_HDLC, Crc};

use crate::registers::Events;

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

    /// The events, and with them what is new at `address`, where outputs are read, if their event says so. Else `into` may hold
    /// anything.
    async fn outputs(&mut self, address: u16, into: &mut [u8]) -> Result<u32, EscError> {
        let events = self.events().await?;
        if Events(events).any(Events::OUTPUTS_WRITTEN) {
            self.read(address, into).await?;
        }
        Ok(events)
    }

    /// Whether one of the events that raise the interrupt is there. A chip that cannot tell by less than a look at its events
    /// leaves that to its caller.
    async fn asks(&mut self) -> Result<bool, EscError> {
        Ok(true)
    }

    /// What a cycle with so many bytes of process data costs on the way to the chip; nothing where there is none.
    fn cycle_cost(&self, _outputs: u16, _inputs: u16, _proves: bool) -> CycleCost {
        CycleCost::default()
    }

    /// Whether the chip answers at all, by a look that neither changes nor waits for anything.
    async fn look(&mut self) -> Result<(), EscError> {
        self.events().await.map(|_| ())
    }
}

/// What a cycle of process data costs on the bus to the chip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CycleCost {
    /// Bytes.
    pub bytes: u32,
    /// Chip selects.
    pub selects: u32,
    /// The bus' clock, of a bit each; 0 where there is no bus.
    pub clock_hz: u32,
    /// What a chip select takes beside its bytes.
    pub select_ns: u32,
}

impl CycleCost {
    /// How long that takes, with `fixed_ns` beside the bus.
    pub fn nanos(self, fixed_ns: u32) -> u32 {
        const BITS_NS: u64 = 8 * 1_000_000_000;
        let bytes = (u64::from(self.bytes) * BITS_NS).checked_div(self.clock_hz.into()).unwrap_or(0);
        let selects = u64::from(self.selects) * u64::from(self.select_ns);
        u32::try_from(bytes + selects + u64::from(fixed_ns)).unwrap_or(u32::MAX)
    }
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
    /// What was done reads back as something else than what was meant: the bus damaged it.
    #[error("an access to the EtherCAT controller at {0:#06x} was damaged on its way")]
    Garbled(u16),
    /// What leads to it cannot be used, and why.
    #[error("{0}")]
    Unreachable(&'static str),
    /// The chip was reset, by itself or because nothing else helped: all its settings are gone, and it is in INIT.
    #[error("the EtherCAT controller was reset")]
    Restarted,
}

/// How often an image is read until two in a row agree; new ones may come in between.
const READS_MAX: usize = 4;
const CHECKSUM: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Reads the whole of a buffered SyncManager's area until it was twice the same, for a bus that may turn bits in data.
///
/// Costs at least twice the traffic, and is fooled only by the same bit falling over twice. A mailbox cannot be read so: its first reading empties it.
pub async fn read_agreed(esc: &mut impl Esc, address: u16, into: &mut [u8]) -> Result<(), EscError> {
    esc.read(address, into).await?;
    agree(esc, address, into).await
}

/// The same of what is in `into` after a first reading.
pub(crate) async fn agree(esc: &mut impl Esc, address: u16, into: &mut [u8]) -> Result<(), EscError> {
    let mut before = CHECKSUM.checksum(into);
    for _ in 1..READS_MAX {
        esc.read(address, into).await?;
        let now = CHECKSUM.checksum(into);
        if now == before {
            return Ok(());
        }
        before = now;
    }
    Err(EscError::Garbled(address))
}
