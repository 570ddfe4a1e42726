//! The standard objects of devices with a mailbox (ETG.1000.6, clause 5.6.7; ETG.1020).

use crate::clocks::{SYNC0_TYPE, SYNC1_TYPE};
use crate::device::Identity;
use crate::diagnosis::{FIRST_MESSAGE, MESSAGE_BYTES, MESSAGES};
use crate::object::{Access, DataType, Entries, Entry, Object, Value};

/// 1000h, device type: the profile's number.
pub const fn device_type(profile: u32) -> Object {
    Object::variable(0x1000, Entry::number("Device type", DataType::U32, profile))
}

/// 1008h, device name.
pub const fn device_name(name: &'static str) -> Object {
    Object::variable(0x1008, Entry::text("Device name", name))
}

/// 1009h, hardware version.
pub const fn hardware_version(version: &'static str) -> Object {
    Object::variable(0x1009, Entry::text("Hardware version", version))
}

/// 100Ah, software version.
pub const fn software_version(version: &'static str) -> Object {
    Object::variable(0x100a, Entry::text("Software version", version))
}

/// 1018h, identity; `entries` is a static with [`identity_entries`].
pub const fn identity(entries: &'static [Entry]) -> Object {
    Object::record(0x1018, "Identity", entries)
}

/// The entries of 1018h.
pub const fn identity_entries(identity: Identity) -> [Entry; 4] {
    [
        Entry::number("Vendor ID", DataType::U32, identity.vendor),
        Entry::number("Product code", DataType::U32, identity.product),
        Entry::number("Revision number", DataType::U32, identity.revision),
        Entry::number("Serial number", DataType::U32, identity.serial),
    ]
}

/// 10F1h, reaction to local errors and lost synchronisation.
pub const ERROR_SETTINGS: Object = {
    const ENTRIES: [Entry; 2] = [
        Entry::number("Local error reaction", DataType::U32, 0),
        // A cycle without outputs or SYNC0 counts 3, a good one -1; 0 is no limit.
        Entry::of_stack("Sync error counter limit", DataType::U16, 0, Access::READ.and(Access::WRITE)),
    ];
    Object::record(0x10f1, "Error settings", &ENTRIES)
};

/// 10F3h, the diagnosis history; provided by the application from its [`History`](crate::diagnosis::History).
pub const DIAGNOSIS_HISTORY: Object = {
    const SETTING: Access = Access::READ.and(Access::WRITE);
    const ENTRIES: [Entry; FIRST_MESSAGE as usize - 1 + MESSAGES] = {
        let message = Entry::reading("Diagnosis message", DataType::Octets(MESSAGE_BYTES as u16));
        let mut entries = [message; FIRST_MESSAGE as usize - 1 + MESSAGES];
        entries[0] = Entry::number("Maximum messages", DataType::U8, MESSAGES as u32);
        entries[1] = Entry::reading("Newest message", DataType::U8);
        entries[2] = Entry::reading("Newest acknowledged message", DataType::U8).with_access(SETTING);
        entries[3] = Entry::reading("New messages available", DataType::Bool);
        entries[4] = Entry::reading("Flags", DataType::U16).with_access(SETTING);
        entries
    };
    Object::record(0x10f3, "Diagnosis history", &ENTRIES)
};

/// 10F8h, the time base of the diagnosis history, in nanoseconds; provided by the application.
pub const TIME_STAMP: Object = Object::variable(0x10f8, Entry::reading("Time stamp", DataType::U64));

/// 1C00h, the purposes of the SyncManagers: mailbox out and in, outputs, inputs.
pub const SYNC_MANAGER_TYPES: Object = Object {
    index: 0x1c00,
    name: "SyncManager types",
    entries: Entries::Constants(&[1, 2, 3, 4], Entry::number("SyncManager type", DataType::U8, 0)),
};

/// Rights of an assignment that can be changed, in PreOp.
pub const SELECTABLE: Access = Access::READ.and(Access::WRITE_PRE_OP);
/// Rights of a fixed assignment.
pub const FIXED: Access = Access::READ;

/// 1C12h, the PDOs of the outputs, [`SELECTABLE`] or [`FIXED`].
pub const fn rx_assignment(initial: &'static [u16], access: Access) -> Object {
    Object { index: 0x1c12, name: "RxPDO assignment", entries: Entries::Assignment(initial, access) }
}

/// 1C13h, the PDOs of the inputs, [`SELECTABLE`] or [`FIXED`].
pub const fn tx_assignment(initial: &'static [u16], access: Access) -> Object {
    Object { index: 0x1c13, name: "TxPDO assignment", entries: Entries::Assignment(initial, access) }
}

/// Supported synchronisation types: free run (bit 0) and SyncManager event (bit 1).
pub(crate) const SYNC_TYPES: u32 = 0b11;
/// Writing 2 to 1C32h:08 or 1C33h:08 resets the counters of that object.
pub const RESET_COUNTERS: u16 = 2;

/// The last entry is 20h.
const fn synchronisation(default: u32) -> [Entry; 32] {
    const RESET: Access = Access::READ.and(Access::WRITE);
    let mut entries = [Entry::ABSENT; 32];
    entries[0x00] = Entry::of_stack("Synchronisation type", DataType::U16, default, SELECTABLE);
    entries[0x01] = Entry::number("Cycle time", DataType::U32, 0);
    entries[0x02] = Entry::number("Shift time", DataType::U32, 0);
    entries[0x03] = Entry::number("Synchronisation types supported", DataType::U16, SYNC_TYPES);
    // Depends on the bus to the controller.
    entries[0x04] = Entry { value: Value::Computed, ..Entry::number("Minimum cycle time", DataType::U32, 0) };
    entries[0x05] = Entry::number("Calc and copy time", DataType::U32, 0);
    entries[0x07] = Entry::of_stack("Get cycle time", DataType::U16, 0, RESET);
    entries[0x08] = Entry::number("Delay time", DataType::U32, 0);
    entries[0x09] = Entry::number("SYNC0 cycle time", DataType::U32, 0);
    entries[0x0a] = Entry::of_stack("SyncManager event missed", DataType::U16, 0, Access::READ);
    entries[0x0b] = Entry::number("Cycle time too small", DataType::U16, 0);
    entries[0x1f] = Entry::number("Synchronisation error", DataType::Bool, 0);
    entries
}

/// The same for a device with SYNC signals.
const fn clocked(default: u32, more: u32) -> [Entry; 32] {
    const fn told(entry: Entry) -> Entry {
        Entry { value: Value::Stack(0), ..entry }
    }
    let mut entries = synchronisation(default);
    entries[0x01] = told(entries[0x01]);
    entries[0x02] = told(entries[0x02]);
    // Without the signals it is less.
    entries[0x03] = Entry { value: Value::Stack(SYNC_TYPES | more), ..entries[0x03] };
    entries[0x05] = Entry { value: Value::Computed, ..entries[0x05] };
    entries[0x09] = told(entries[0x09]);
    entries[0x0b] = told(entries[0x0b]);
    entries[0x1f] = told(entries[0x1f]);
    entries
}

/// 1C32h of a device that has [`SyncSignals`](crate::clocks::SyncSignals).
pub const OUTPUT_CLOCKS: Object = {
    const ENTRIES: [Entry; 32] = clocked(0x01, SYNC0_TYPE);
    Object::record(0x1c32, "Output SyncManager parameters", &ENTRIES)
};

/// 1C33h of a device that has them: inputs at SYNC0 or SYNC1.
pub const INPUT_CLOCKS: Object = {
    const ENTRIES: [Entry; 32] = clocked(0x22, SYNC0_TYPE | SYNC1_TYPE);
    Object::record(0x1c33, "Input SyncManager parameters", &ENTRIES)
};

/// 1C32h, synchronisation of outputs.
pub const OUTPUT_SYNCHRONISATION: Object = {
    const ENTRIES: [Entry; 32] = synchronisation(0x01);
    Object::record(0x1c32, "Output SyncManager parameters", &ENTRIES)
};

/// 1C33h, synchronisation of inputs.
pub const INPUT_SYNCHRONISATION: Object = {
    const ENTRIES: [Entry; 32] = synchronisation(0x22);
    Object::record(0x1c33, "Input SyncManager parameters", &ENTRIES)
};
