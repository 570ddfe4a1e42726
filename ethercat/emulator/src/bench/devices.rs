//! The bench's devices: equal except for mailbox sizes, with objects for every SDO feature.

use ethercat_subdevice::device::{Device, Identity};
use ethercat_subdevice::foe::FileAccess;
use ethercat_subdevice::object::{Access, DataType, Entry, Mapped, Object};
use ethercat_subdevice::standard;
use ethercat_subdevice::sync_manager::MemoryPlan;

/// Bytes of object 2100h.
pub const LARGE_BYTES: usize = 300;

/// With the shortest possible mailboxes.
pub static MAILBOX_34: Device = device(34);
/// With mailboxes of 64 bytes.
pub static MAILBOX_64: Device = device(64);
/// With mailboxes of 128 bytes.
pub static MAILBOX_128: Device = device(128);
/// With Ethernet, files and mailboxes of 64 bytes.
pub static ETHERNET_64: Device = Device { ethernet: true, files: FileAccess::WithBoot, ..device(64) };
/// The same with mailboxes of 128 bytes.
pub static ETHERNET_128: Device = Device { ethernet: true, files: FileAccess::WithBoot, ..device(128) };
/// With the shortest mailboxes, files and the Boot state.
pub static FILES_34: Device = Device { files: FileAccess::WithBoot, ..device(34) };
/// The same with mailboxes of 128 bytes.
pub static FILES_128: Device = Device { files: FileAccess::WithBoot, ..device(128) };

const IDENTITY: Identity =
    Identity { vendor: 0x1234_5678, product: 0x9abc_def0, revision: 0x11, serial: 0x22 };
const IDENTITY_ENTRIES: &[Entry] = &standard::identity_entries(IDENTITY);

const ANY: (u32, u32) = (0, u32::MAX);

const RECORD: &[Entry] = &[
    Entry::setting("Byte", DataType::U8, 0, (0, 100)),
    Entry::setting("Word", DataType::U16, 0, ANY),
    Entry::setting("Double word", DataType::U32, 0, ANY),
];

/// Its second value is read-only.
const MIXED: &[Entry] =
    &[Entry::setting("Read and write", DataType::U16, 0, ANY), Entry::number("Read only", DataType::U16, 7)];

const OUTPUT: Entry = Entry::reading("Output", DataType::U8).with_access(Access::READ.and(Access::RX_PDO));
const INPUT: Entry = Entry::reading("Input", DataType::U8).with_access(Access::READ.and(Access::TX_PDO));

/// With distributed clocks: SYNC0 and SYNC1 as push-pull, active-high outputs with pulses of 10 us.
pub static CLOCKED: Device = Device {
    memory: MemoryPlan::new(128, 120, 120, 4096),
    controller: [0x80, 0x04, 0, 0x66, 0xe8, 0x03, 0, 0],
    objects: CLOCKED_OBJECTS,
    ..device(128)
};
/// The same with 16 bytes of process data each way.
pub static CLOCKED_16: Device = Device { objects: CLOCKED_16_OBJECTS, ..CLOCKED };

const CLOCKED_OBJECTS: &[Object] = &clocked(120);
const CLOCKED_16_OBJECTS: &[Object] = &clocked(16);

/// Sorted by index.
const fn clocked(bytes: u8) -> [Object; 12] {
    [
        standard::device_type(0),
        standard::identity(IDENTITY_ENTRIES),
        standard::ERROR_SETTINGS,
        Object::mapping(0x1600, "All outputs", &[Mapped { index: 0x3000, sub: 1, count: bytes, bits: 8 }]),
        Object::mapping(0x1a00, "All inputs", &[Mapped { index: 0x3001, sub: 1, count: bytes, bits: 8 }]),
        standard::SYNC_MANAGER_TYPES,
        standard::rx_assignment(&[0x1600], standard::FIXED),
        standard::tx_assignment(&[0x1a00], standard::FIXED),
        standard::OUTPUT_CLOCKS,
        standard::INPUT_CLOCKS,
        Object::array(0x3000, "Outputs", 120, OUTPUT),
        Object::array(0x3001, "Inputs", 120, INPUT),
    ]
}

const OBJECTS: &[Object] = &[
    standard::device_type(0),
    standard::device_name("A bench for everything that the CAN application protocol over EtherCAT can do"),
    standard::identity(IDENTITY_ENTRIES),
    Object::mapping(0x1600, "All outputs", &[Mapped { index: 0x3000, sub: 1, count: 120, bits: 8 }]),
    Object::mapping(0x1601, "Some outputs", &[Mapped { index: 0x3000, sub: 1, count: 4, bits: 8 }]),
    Object::mapping(0x1a00, "All inputs", &[Mapped { index: 0x3001, sub: 1, count: 120, bits: 8 }]),
    Object::mapping(0x1a01, "Some inputs", &[Mapped { index: 0x3001, sub: 1, count: 4, bits: 8 }]),
    standard::SYNC_MANAGER_TYPES,
    standard::rx_assignment(&[0x1600], standard::SELECTABLE),
    standard::tx_assignment(&[0x1a00], standard::SELECTABLE),
    standard::OUTPUT_SYNCHRONISATION,
    standard::INPUT_SYNCHRONISATION,
    Object::variable(0x2100, Entry::setting("Large", DataType::Octets(LARGE_BYTES as u16), 0, ANY)),
    Object::variable(0x2101, Entry::setting("Text", DataType::Text(40), 0, ANY)),
    Object::variable(0x2102, Entry::setting("Write only", DataType::U16, 0, ANY).with_access(Access::WRITE)),
    Object::variable(
        0x2103,
        Entry::setting("In PreOp", DataType::U16, 0, ANY).with_access(standard::SELECTABLE),
    ),
    Object::variable(0x2104, Entry::setting("Ten to twenty", DataType::U8, 10, (10, 20))),
    Object::record(0x2105, "Record", RECORD),
    Object::variable(0x2106, Entry::setting("Not thirteen", DataType::U8, 0, ANY)),
    Object::record(0x2107, "Mixed", MIXED),
    Object::array(0x3000, "Outputs", 120, OUTPUT),
    Object::array(0x3001, "Inputs", 120, INPUT),
];

const fn device(mailbox_bytes: u16) -> Device {
    Device {
        identity: IDENTITY,
        vendor_name: "Bench & Co",
        name: "Bench",
        order: "BENCH",
        group: "Benches",
        memory: MemoryPlan::new(mailbox_bytes, 120, 120, 4096),
        controller: [0x80, 0, 0, 0, 0, 0, 0, 0],
        emergencies: false,
        files: FileAccess::None,
        ethernet: false,
        texts: &[],
        objects: OBJECTS,
    }
}
