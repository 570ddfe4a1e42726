//! The controller's registers used by this stack, and their bits (ET1100 data sheet, section II).

/// Number of SyncManagers, one byte; the next byte is the number of KiB of process memory.
pub const SYNC_MANAGERS_PRESENT: u16 = 0x0005;
/// Configured station address, two bytes.
pub const STATION_ADDRESS: u16 = 0x0010;
/// Station alias, two bytes: the SII's word 4 at power-on.
pub const STATION_ALIAS: u16 = 0x0012;
/// AL control, two bytes: the MainDevice's state request. Reading it unlocks it for the MainDevice.
pub const AL_CONTROL: u16 = 0x0120;
/// AL status, two bytes.
pub const AL_STATUS: u16 = 0x0130;
/// AL status code, two bytes; written before the status, so that an error flag never appears without its code.
pub const AL_STATUS_CODE: u16 = 0x0134;
/// Mask of the AL events that assert the interrupt, four bytes.
pub const AL_EVENT_MASK: u16 = 0x0204;
/// AL event request, four bytes; not masked.
pub const AL_EVENT_REQUEST: u16 = 0x0220;
/// Whether the process data watchdog is running (or disabled), two bytes; reading clears its event.
pub const WATCHDOG_STATUS: u16 = 0x0440;
/// The SyncManagers, [`SYNC_MANAGER_BYTES`] each.
pub const SYNC_MANAGERS: u16 = 0x0800;
/// Distributed clocks: who controls the SYNC and LATCH units, one byte; the next is the activation of SYNC0 and SYNC1.
pub const SYNC_CONTROL: u16 = 0x0980;
/// The cycle of SYNC0, and the time from SYNC0 to SYNC1, four bytes each.
pub const SYNC_CYCLES: u16 = 0x09a0;

/// Size of one SyncManager's block.
pub const SYNC_MANAGER_BYTES: u16 = 8;
/// A SyncManager's activation, relative to its block. Reading it clears its part of the change event.
pub const SYNC_MANAGER_ACTIVATE: u16 = 6;
/// A SyncManager's PDI control, relative to its block.
pub const SYNC_MANAGER_PDI_CONTROL: u16 = 7;

/// The AL event request, or a mask of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Events(pub u32);

impl Events {
    /// The MainDevice wrote AL control.
    pub const AL_CONTROL: Self = Self(1 << 0);
    /// A SyncManager's activation was written.
    pub const SYNC_MANAGER_CHANGED: Self = Self(1 << 4);
    /// The process data watchdog expired.
    pub const WATCHDOG: Self = Self(1 << 6);
    /// SM0 received a message.
    pub const MAILBOX_WRITTEN: Self = Self(1 << 8);
    /// SM1's message was read.
    pub const MAILBOX_FETCHED: Self = Self(1 << 9);
    /// SM2 received outputs.
    pub const OUTPUTS_WRITTEN: Self = Self(1 << 10);
    /// SM3's inputs were read.
    pub const INPUTS_FETCHED: Self = Self(1 << 11);

    /// Whether any of `wanted` is set.
    pub const fn any(self, wanted: Self) -> bool {
        self.0 & wanted.0 != 0
    }

    /// These events, and `more` if `condition` holds.
    #[must_use]
    pub const fn with_if(self, condition: bool, more: Self) -> Self {
        if condition { Self(self.0 | more.0) } else { self }
    }
}
