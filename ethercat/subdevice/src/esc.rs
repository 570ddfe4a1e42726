//! The interface of a controller chip: access to its registers and memory from the process data interface.

use crc::{CRC_32_ISO_HDLC, Crc};

use crate::registers::Events;

/// An EtherCAT SubDevice controller, as its processor sees it.
///
/// Addresses are those of the ESC's own memory: registers below 1000h, then mailboxes and process data. An access has the chip's
/// side effects: it may clear events, and access to the last byte of a SyncManager's buffer releases the buffer.
pub trait Esc {
    /// Reads `into.len()` bytes from `address` on.
    async fn read(&mut self, address: u16, into: &mut [u8]) -> Result<(), EscError>;

    /// Writes `bytes` from `address` on.
    async fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), EscError>;

    /// The AL event request (register 0220h).
    async fn events(&mut self) -> Result<u32, EscError>;

    /// Reads the events, and also the outputs at `address` if there is an event for them. Otherwise `into` is undefined.
    async fn outputs(&mut self, address: u16, into: &mut [u8]) -> Result<u32, EscError> {
        let events = self.events().await?;
        if Events(events).any(Events::OUTPUTS_WRITTEN) {
            self.read(address, into).await?;
        }
        Ok(events)
    }

    /// Whether an event asserts the interrupt. True if the chip cannot tell without reading the event register; the caller then
    /// reads it.
    async fn asks(&mut self) -> Result<bool, EscError> {
        Ok(true)
    }

    /// Bus cost of a cycle with so many bytes of process data; zero without a bus.
    fn cycle_cost(&self, _outputs: u16, _inputs: u16, _proves: bool) -> CycleCost {
        CycleCost::default()
    }

    /// Checks that the chip responds, without side effects and without waiting.
    async fn look(&mut self) -> Result<(), EscError> {
        self.events().await.map(|_| ())
    }
}

/// Bus cost of a process data cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CycleCost {
    /// Number of bytes.
    pub bytes: u32,
    /// Number of chip selects.
    pub selects: u32,
    /// The bus clock, one bit per cycle; 0 without a bus.
    pub clock_hz: u32,
    /// Overhead of a chip select.
    pub select_ns: u32,
}

impl CycleCost {
    /// Duration of the cycle, with `fixed_ns` besides the bus.
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
    /// Something other than the chip responded: it is absent, in reset, or the wiring is wrong.
    #[error("no EtherCAT controller responds: {0:#010x} read instead of its test pattern")]
    Absent(u32),
    /// The chip exceeded its timeout.
    #[error("the EtherCAT controller did not finish at {0:#06x}")]
    Stuck(u16),
    /// A read-back differed: the bus corrupted the access.
    #[error("an access to the EtherCAT controller at {0:#06x} was corrupted on its way")]
    Garbled(u16),
    /// The chip's bus is not usable, with the reason.
    #[error("{0}")]
    Unreachable(&'static str),
    /// The chip was reset, by itself or as the last resort: all its settings are lost, and it is in INIT.
    #[error("the EtherCAT controller was reset")]
    Restarted,
}

/// Most reads of an image until two in a row agree; new images may arrive in between.
const READS_MAX: usize = 4;
const CHECKSUM: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Reads a buffered SyncManager's whole area until two reads agree, for a bus that may flip bits.
///
/// Costs at least twice the traffic, and misses only the same bit flip twice. Not for mailboxes: the first read empties them.
pub async fn read_agreed(esc: &mut impl Esc, address: u16, into: &mut [u8]) -> Result<(), EscError> {
    esc.read(address, into).await?;
    agree(esc, address, into).await
}

/// The same, with the first read already in `into`.
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
