//! SyncManagers: the layout of mailboxes and process data in the controller's memory, and checks of the MainDevice's settings.

use crate::al_state::AlStatusCode;
use crate::registers::{SYNC_MANAGER_BYTES, SYNC_MANAGER_PDI_CONTROL, SYNC_MANAGERS};

/// Number of SyncManagers used: two mailboxes, outputs, inputs.
pub const SYNC_MANAGERS_USED: usize = 4;
/// Most SyncManagers of a controller.
pub const SYNC_MANAGERS_MAX: u8 = 16;
/// Start of process memory; registers are below.
pub const MEMORY_START: u16 = 0x1000;
/// Least bytes of a mailbox: both headers of CoE, 8 bytes of SDO, and headroom (ETG.1000.4 requires 34).
pub const MAILBOX_BYTES_MIN: u16 = 34;

/// The number of a SyncManager in use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Channel {
    /// Messages of the MainDevice.
    MailboxOut = 0,
    /// Messages of the SubDevice.
    MailboxIn = 1,
    /// Outputs.
    Outputs = 2,
    /// Inputs.
    Inputs = 3,
}

impl Channel {
    /// All channels, by number.
    pub const ALL: [Self; SYNC_MANAGERS_USED] =
        [Self::MailboxOut, Self::MailboxIn, Self::Outputs, Self::Inputs];

    /// The address of its register block.
    pub const fn registers(self) -> u16 {
        SYNC_MANAGERS + SYNC_MANAGER_BYTES * self as u16
    }

    /// The address of its PDI control register.
    pub const fn pdi_control(self) -> u16 {
        self.registers() + SYNC_MANAGER_PDI_CONTROL
    }

    /// Its type in 1C00h and in the SII.
    pub const fn purpose(self) -> u8 {
        self as u8 + 1
    }

    /// The control byte that the MainDevice should write.
    pub const fn control(self) -> u8 {
        match self {
            Self::MailboxOut => 0x26,
            Self::MailboxIn => 0x22,
            Self::Outputs => 0x64,
            Self::Inputs => 0x20,
        }
    }

    /// The AL status code for wrong settings.
    pub const fn fault(self) -> AlStatusCode {
        match self {
            Self::MailboxOut | Self::MailboxIn => AlStatusCode::InvalidMailbox,
            Self::Outputs => AlStatusCode::InvalidOutputs,
            Self::Inputs => AlStatusCode::InvalidInputs,
        }
    }
}

/// A SyncManager's registers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SyncManager {
    /// Start address of its buffer.
    pub start: u16,
    /// Bytes of its buffer.
    pub length: u16,
    /// Mode, direction, events, watchdog.
    pub control: u8,
    /// State of its buffers.
    pub status: u8,
    /// Activation by the MainDevice, and the repeat request.
    pub activate: u8,
}

impl SyncManager {
    /// Mode (bits 1:0), direction (bits 3:2) and the event for this side (bit 5), which is required; the event for the MainDevice
    /// and the watchdog are the MainDevice's choice.
    const KIND: u8 = 0x2f;
    const ENABLE: u8 = 1 << 0;
    const REPEAT: u8 = 1 << 1;
    /// The mailbox is full.
    const FULL: u8 = 1 << 3;
    /// The last written buffer (bits 5:4); 3 means none.
    const NEVER_WRITTEN: u8 = 3 << 4;

    /// Decodes the 8 bytes of its block.
    pub const fn from_bytes(block: [u8; SYNC_MANAGER_BYTES as usize]) -> Self {
        let [start_low, start_high, length_low, length_high, control, status, activate, _pdi] = block;
        Self {
            start: u16::from_le_bytes([start_low, start_high]),
            length: u16::from_le_bytes([length_low, length_high]),
            control,
            status,
            activate,
        }
    }

    /// Whether the MainDevice has enabled it.
    pub const fn enabled(self) -> bool {
        self.activate & Self::ENABLE != 0
    }

    /// The bit that the MainDevice toggles to request a repetition.
    pub const fn repeat(self) -> bool {
        self.activate & Self::REPEAT != 0
    }

    /// Whether it holds an unread message.
    pub const fn is_full(self) -> bool {
        self.status & Self::FULL != 0
    }

    /// Whether process data were written since it was switched on.
    pub const fn was_written(self) -> bool {
        self.status & Self::NEVER_WRITTEN != Self::NEVER_WRITTEN
    }

    /// Checks that it serves `channel` with `length` bytes at `start`; for a length of 0 it must be off or empty.
    pub fn check(self, channel: Channel, start: u16, length: u16) -> Result<(), AlStatusCode> {
        let kind_fits = (self.control ^ channel.control()) & Self::KIND == 0;
        let good = match length {
            0 => !self.enabled() || self.length == 0,
            _ => self.enabled() && kind_fits && self.start == start && self.length == length,
        };
        if good { Ok(()) } else { Err(channel.fault()) }
    }
}

/// The layout of the controller's memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryPlan {
    /// Bytes of each of the two mailboxes.
    pub mailbox_bytes: u16,
    /// Most bytes of outputs.
    pub outputs_bytes_max: u16,
    /// Most bytes of inputs.
    pub inputs_bytes_max: u16,
}

impl MemoryPlan {
    /// A plan for `memory_bytes` of process memory. The [`SubDevice`](crate::sub_device::SubDevice) has the image buffers.
    ///
    /// # Panics
    /// If the plan does not fit; at build time, when used in a `const` as intended.
    pub const fn new(
        mailbox_bytes: u16,
        outputs_bytes_max: u16,
        inputs_bytes_max: u16,
        memory_bytes: u16,
    ) -> Self {
        let plan = Self { mailbox_bytes, outputs_bytes_max, inputs_bytes_max };
        assert!(mailbox_bytes >= MAILBOX_BYTES_MIN, "a mailbox has 34 bytes at least");
        assert!(mailbox_bytes as usize <= crate::mailbox::MAILBOX_BYTES_MAX, "messages are kept in buffers");
        let end = plan.start(Channel::Inputs) as u32 + 3 * inputs_bytes_max as u32;
        let fits = end <= MEMORY_START as u32 + memory_bytes as u32;
        assert!(fits, "three buffers of inputs and outputs must fit");
        plan
    }

    /// Most bytes of a channel in a controller with `kib` KiB of process memory: the planned ones, or what fits there three times.
    pub fn room(&self, channel: Channel, kib: u8) -> u16 {
        let planned = match channel {
            Channel::MailboxOut | Channel::MailboxIn => return self.mailbox_bytes,
            Channel::Outputs => self.outputs_bytes_max,
            Channel::Inputs => self.inputs_bytes_max,
        };
        let end = u32::from(MEMORY_START) + u32::from(kib) * 1024;
        let fit = end.saturating_sub(self.start(channel).into()) / 3;
        u16::try_from(fit).map_or(planned, |fit| fit.min(planned))
    }

    /// Start address of a channel's buffer, a multiple of 8. Process data have three consecutive buffers.
    pub const fn start(&self, channel: Channel) -> u16 {
        let mailbox = self.mailbox_bytes.next_multiple_of(8);
        match channel {
            Channel::MailboxOut => MEMORY_START,
            Channel::MailboxIn => MEMORY_START + mailbox,
            Channel::Outputs => MEMORY_START + 2 * mailbox,
            Channel::Inputs => MEMORY_START + 2 * mailbox + (3 * self.outputs_bytes_max).next_multiple_of(8),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Channel, MemoryPlan, SyncManager};
    use crate::al_state::AlStatusCode;

    const PLAN: MemoryPlan = MemoryPlan::new(128, 120, 120, 4096);

    /// As SOEM writes them.
    const SM0: [u8; 8] = [0x00, 0x10, 0x80, 0x00, 0x26, 0x00, 0x01, 0x00];
    const SM2: [u8; 8] = [0x00, 0x11, 0x78, 0x00, 0x64, 0x00, 0x01, 0x00];

    #[test]
    fn the_plan_puts_mailboxes_first_and_three_buffers_each_behind() {
        assert_eq!(Channel::ALL.map(|channel| PLAN.start(channel)), [0x1000, 0x1080, 0x1100, 0x1268]);
    }

    #[test]
    fn a_smaller_memory_leaves_as_much_room_as_three_buffers_take() {
        let plan = MemoryPlan::new(128, 1_500, 1_486, 10 * 1024);
        let room = |kib| [Channel::Outputs, Channel::Inputs].map(|channel| plan.room(channel, kib));
        assert_eq!([room(64), room(60), room(10)], [[1_500, 1_486]; 3]);
        // Inputs begin at 2298h: 3432 bytes are left in 8 KiB, none in 4.
        assert_eq!([room(8), room(4), room(0)], [[1_500, 1_144], [1_280, 0], [0, 0]]);
    }

    #[test]
    fn what_a_main_device_writes_is_accepted() {
        assert_eq!(SyncManager::from_bytes(SM0).check(Channel::MailboxOut, 0x1000, 128), Ok(()));
        assert_eq!(SyncManager::from_bytes(SM2).check(Channel::Outputs, 0x1100, 120), Ok(()));
    }

    #[test]
    fn the_watchdog_bit_and_the_main_devices_event_bit_are_its_own_choice() {
        for control in [0x24, 0x34, 0x64, 0x74] {
            let mut block = SM2;
            block[4] = control;
            assert_eq!(SyncManager::from_bytes(block).check(Channel::Outputs, 0x1100, 120), Ok(()));
        }
    }

    #[test]
    fn each_wrong_field_is_found() {
        for (at, change) in [(0, 1), (1, 1), (2, 1), (2, 0xff), (4, 0x02), (4, 0x04), (4, 0x20), (6, 0x01)] {
            let mut block = SM0;
            block[at] ^= change;
            let checked = SyncManager::from_bytes(block).check(Channel::MailboxOut, 0x1000, 128);
            assert_eq!(checked, Err(AlStatusCode::InvalidMailbox), "byte {at} ^ {change:#x}");
        }
    }

    #[test]
    fn without_bytes_a_sync_manager_must_be_off() {
        let on = SyncManager::from_bytes(SM2);
        assert_eq!(on.check(Channel::Outputs, 0x1100, 0), Err(AlStatusCode::InvalidOutputs));
        let off = SyncManager { activate: 0, ..on };
        assert_eq!(off.check(Channel::Outputs, 0x1100, 0), Ok(()));
        assert_eq!(off.check(Channel::Outputs, 0x1100, 120), Err(AlStatusCode::InvalidOutputs));
    }
}
