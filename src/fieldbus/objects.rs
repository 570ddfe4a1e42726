//! The gateway's object dictionary: the single table behind SDO, EEPROM and ESI file.
//!
//! Vendor id and product code are build parameters, the variables `MOBGATE_ETHERCAT_VENDOR` and `MOBGATE_ETHERCAT_PRODUCT` (decimal
//! or `0x`): the EtherCAT Technology Group assigns vendor ids. The default belongs to nobody, and is for evaluation only.

use ethercat_subdevice::device::{Device, Identity};
use ethercat_subdevice::foe::FileAccess;
use ethercat_subdevice::object::{Access, DataType, Entry, Mapped, Object};
use ethercat_subdevice::standard;
use ethercat_subdevice::sync_manager::MemoryPlan;

use super::request::REQUEST_BYTES_MAX;
use super::room::{
    FIRST_BYTES, IMAGE_BYTES, LONG_ENTRY, LONG_FIRST_END, LONG_INPUTS, LONG_OUTPUTS, LONG_SECOND_END,
    SECOND_END,
};
use super::slaves::{CONFIGURATIONS, HEALTH, LAYOUTS, SLAVES, SLAVES_FIRST, STATUSES, first_four};
use super::texts::TEXTS;
use crate::modbus::PDU_BYTES_MAX;
use crate::scanner::REQUESTERS;

/// Bytes of the reason for refusing a configuration (2006h).
pub const REASON_BYTES: u16 = 48;
/// Bytes of inputs besides the image: a counter, the health of four slaves, and the state of all of them.
const STATUS_BYTES: u16 = 1 + SLAVES_FIRST as u16 + 2 * SLAVES as u16;

/// Data points that have entries: the largest number on any board.
const POINTS: u8 = 128;

const EVALUATION_VENDOR: u32 = 0xffff_0001;
const EVALUATION_PRODUCT: u32 = 0x0000_0001;

const IDENTITY: Identity = Identity {
    vendor: parameter(option_env!("MOBGATE_ETHERCAT_VENDOR"), EVALUATION_VENDOR),
    product: parameter(option_env!("MOBGATE_ETHERCAT_PRODUCT"), EVALUATION_PRODUCT),
    revision: 0x0001_0000,
    serial: 0,
};

/// The gateway.
pub const DEVICE: Device = Device {
    identity: IDENTITY,
    vendor_name: "mobgate",
    name: "mobgate EtherCAT to Modbus gateway",
    order: "mobgate",
    group: "Gateways",
    // A LAN9252 has 4 KiB of process memory: mailboxes of 128 bytes leave 1280 bytes for both images, each triple-buffered. Their
    // start does not depend on the assigned PDOs.
    memory: MemoryPlan::new(128, IMAGE_BYTES, (IMAGE_BYTES + STATUS_BYTES).next_multiple_of(8), 4096),
    // LAN9252: SPI; SYNC0 and SYNC1 at pins, push-pull and active high, with pulses of 10 us.
    controller: [0x80, 0x04, 0, 0x66, 0xe8, 0x03, 0, 0],
    // Some MainDevices (ethercrab 0.7) fail at the first one: 10F3h:05 and the port's settings enable them.
    emergencies: false,
    files: FileAccess::None,
    ethernet: false,
    texts: TEXTS,
    objects: OBJECTS,
};

/// The gateway for a controller with memory for longer images: the same objects, and PDOs for more bytes.
pub const LONG_DEVICE: Device = Device {
    identity: LONG_IDENTITY,
    files: FileAccess::WithoutBoot,
    name: "mobgate EtherCAT to Modbus gateway, long images",
    order: "mobgate-long",
    // The longest images take 9426 bytes; a controller with less memory gets shorter ones.
    memory: MemoryPlan::new(128, LONG_OUTPUTS, LONG_INPUTS + STATUS_BYTES, 10 * 1024),
    objects: LONG_OBJECTS,
    ..DEVICE
};

pub(super) const MODBUS: &[Entry] =
    &[Entry::setting("NumSlave", DataType::U16, SLAVES_FIRST as u32, (0, SLAVES as u32))];

pub(super) const FLAGS: &[Entry] = &[
    Entry::setting("ConfigUpdateFlag", DataType::U16, 0, (0, 1)),
    // Set by the gateway; a MainDevice can only reset it.
    Entry::setting("ConfigUpdateCompletedFlag", DataType::U16, 0, (0, 0)),
];

pub(super) const UART: &[Entry] = &[
    Entry::setting("BaudRate", DataType::U32, 115_200, (1_200, 4_000_000)),
    Entry::setting("BitCountPerChar", DataType::U16, 0, (0, 1)),
    Entry::setting("ParityMode", DataType::U16, 0, (0, 3)),
    Entry::setting("StopBitCount", DataType::U16, 0, (0, 1)),
];

pub(super) const STATUS: &[Entry] = &[Entry::input("InputCounter", DataType::U8)];

const CHECK: Entry = Entry::setting("CheckBeforePoll", DataType::U8, 0, (0, 1));

/// 0: hold, 1: clear, 2: substitute.
const ON_SILENCE: Entry = Entry::setting("OnSilence", DataType::U8, 0, (0, 2));

const SUBSTITUTE: Entry = Entry::setting("Substitute", DataType::U16, 0, (0, u16::MAX as u32));

/// Health in bits 0 and 1, state of the inputs in bits 2 and 3 (see 2180h), bit 7 toggles with every response, and bits 8 to 15 are
/// the last exception.
const STATE: Entry = Entry::input("State", DataType::U16);

/// The state is coded as in 1023h of CiA 301: 0: ended without response; 1: answered; 2: failed; 3: answered by an exception; 255:
/// in progress.
const REQUEST: &[Entry] = &[
    Entry {
        access: Access::WRITE,
        ..Entry::reading("UnitAndPdu", DataType::OctetsUpTo(REQUEST_BYTES_MAX as u16))
    },
    Entry::reading("State", DataType::U8),
    Entry::reading("ResponsePdu", DataType::OctetsUpTo(PDU_BYTES_MAX as u16)),
    Entry::reading("Error", DataType::U8),
    // Number of bytes of 2034h that form the request to send.
    Entry::setting("SendParts", DataType::U8, 0, (2, REQUEST_BYTES_MAX as u32)).with_access(Access::WRITE),
];

/// Unit and PDU in four-byte parts, for MainDevices limited to expedited SDO writes.
const REQUEST_PART: Entry =
    Entry { access: Access::WRITE, ..Entry::reading("UnitAndPduPart", DataType::U32) };

/// High byte: the requester number, of a MainDevice or one of its tasks. Low byte: the command when written, its progress when
/// read, as in the holding registers of the own unit.
const POINT_COMMAND: Entry = Entry::setting("Command", DataType::U16, 0, (0, u16::MAX as u32))
    .with_access(Access::READ.and(Access::WRITE));

/// Count is written last, and executes the command.
const POINT_RANGE: &[Entry] =
    &[range_entry("RequesterAndDevice"), range_entry("Function"), range_entry("First"), range_entry("Count")];

const fn range_entry(name: &'static str) -> Entry {
    Entry { name, ..POINT_COMMAND }
}

/// Writes take a signature (CiA 301, 7.5.2.13 and 14); reads indicate saving on command.
const fn on_command(name: &'static str) -> Entry {
    Entry::setting(name, DataType::U32, 1, (0, u32::MAX)).with_access(Access::READ.and(Access::WRITE))
}

/// All entries of an object, in order.
const fn all_of(index: u16, count: u8, bits: u8) -> Mapped {
    Mapped { index, sub: 1, count, bits }
}

/// The bytes from `first` to `end` of a buffer whose object has eight-byte entries.
const fn by_eight(index: u16, first: u16, end: u16) -> Mapped {
    Mapped { index, sub: (first / 8) as u8 + 1, count: ((end - first) / 8) as u8, bits: 64 }
}

const IDENTITY_ENTRIES: &[Entry] = &standard::identity_entries(IDENTITY);

/// A different memory layout makes it another product, the one after next.
const LONG_IDENTITY: Identity = Identity { product: IDENTITY.product.wrapping_add(2), ..IDENTITY };
const LONG_IDENTITY_ENTRIES: &[Entry] = &standard::identity_entries(LONG_IDENTITY);

pub(super) const STORE: Object =
    Object::array(0x1010, "Store parameters", 1, on_command("Save all parameters"));
pub(super) const RESTORE: Object =
    Object::array(0x1011, "Restore default parameters", 1, on_command("Restore all default parameters"));
pub(super) const REASON: Object =
    Object::variable(0x2006, Entry::reading("ConfigRefusedBecause", DataType::Text(REASON_BYTES)));

const BEFORE_IDENTITY: &[Object] = &[
    standard::device_type(0x0000_1389),
    standard::device_name("mobgate EtherCAT to Modbus gateway"),
    standard::hardware_version("1"),
    standard::software_version(env!("CARGO_PKG_VERSION")),
    STORE,
    RESTORE,
];

const FIRST_OUTPUT_PDOS: &[Object] = &[
    standard::ERROR_SETTINGS,
    standard::DIAGNOSIS_HISTORY,
    standard::TIME_STAMP,
    Object::mapping(0x1600, "Outputs by byte", &[all_of(0x2022, FIRST_BYTES as u8, 8)])
        .excluding(&[0x1601])
        .undescribed(),
    Object::mapping(0x1601, "Outputs 0 to 119", &[by_eight(0x2024, 0, FIRST_BYTES)]),
];

const OUTPUT_PDOS: &[Object] = &[
    Object::mapping(0x1602, "Outputs 120 to 255", &[by_eight(0x2024, FIRST_BYTES, SECOND_END)]),
    Object::mapping(0x1603, "Outputs 256 to 511", &[by_eight(0x2024, SECOND_END, IMAGE_BYTES)]),
];

const FIRST_INPUT_PDOS: &[Object] = &[
    Object::mapping(0x1a00, "Inputs by byte", &[all_of(0x2021, FIRST_BYTES as u8, 8)])
        .excluding(&[0x1a01])
        .undescribed(),
    Object::mapping(0x1a01, "Inputs 0 to 119", &[by_eight(0x2023, 0, FIRST_BYTES)]),
    Object::mapping(0x1a02, "Status", &[all_of(0x2030, 1, 8)]),
    Object::mapping(0x1a03, "Health of the first four slaves", &[all_of(0x2031, SLAVES_FIRST, 8)]),
];

const INPUT_PDOS: &[Object] = &[
    Object::mapping(0x1a04, "Inputs 120 to 255", &[by_eight(0x2023, FIRST_BYTES, SECOND_END)]),
    Object::mapping(0x1a05, "Inputs 256 to 511", &[by_eight(0x2023, SECOND_END, IMAGE_BYTES)]),
    STATE_PDO,
];

const STATE_PDO: Object = Object::mapping(0x1a06, "State of all slaves", &[all_of(0x2032, SLAVES, 16)]);

const BEHIND_PDOS: &[Object] = &[
    standard::SYNC_MANAGER_TYPES,
    standard::rx_assignment(&[0x1601], standard::SELECTABLE),
    standard::tx_assignment(&[0x1a01], standard::SELECTABLE),
    standard::OUTPUT_CLOCKS,
    standard::INPUT_CLOCKS,
    Object::record(0x2000, "ModbusConfig", MODBUS),
];

const BEFORE_LAYOUTS: &[Object] = &[
    Object::record(0x2005, "ConfigUpdateAndCompletedFlag", FLAGS),
    REASON,
    Object::array(0x2007, "CheckBeforePollSlaves", SLAVES, CHECK),
    Object::array(0x2008, "OnSilenceOfSlaves", SLAVES, ON_SILENCE),
    Object::array(0x2009, "SubstituteOfSlaves", SLAVES, SUBSTITUTE),
    // 0: the settings, as typed or loaded; 1: the MainDevice.
    Object::variable(0x200a, Entry::reading("UartSetBy", DataType::U8)),
];

const BUFFERS: &[Object] = &[
    Object::record(0x2020, "UartConfigUart1", UART),
    Object::array(0x2021, "InputBuffer", FIRST_BYTES as u8, Entry::input("Input byte", DataType::U8)),
    Object::array(0x2022, "OutputBuffer", FIRST_BYTES as u8, Entry::output("Output byte", DataType::U8)),
    Object::array(
        0x2023,
        "InputBufferByEight",
        (IMAGE_BYTES / 8) as u8,
        Entry::input("Input bytes", DataType::Octets(8)),
    ),
    Object::array(
        0x2024,
        "OutputBufferByEight",
        (IMAGE_BYTES / 8) as u8,
        Entry::output("Output bytes", DataType::Octets(8)),
    ),
];

const STATES: &[Object] = &[
    Object::record(0x2030, "Status", STATUS),
    Object::array(0x2031, "HealthOfSlaves", SLAVES, HEALTH),
    Object::array(0x2032, "StateOfSlaves", SLAVES, STATE),
];

pub(super) const BEHIND_STATES: &[Object] = &[
    Object::record(0x2033, "ModbusRequest", REQUEST),
    Object::array(0x2034, "ModbusRequestByFour", REQUEST_BYTES_MAX.div_ceil(4) as u8, REQUEST_PART),
    Object::array(0x2040, "PointCommands", POINTS, POINT_COMMAND),
    Object::array(0x2041, "PointStatus", POINTS, Entry::reading("Status", DataType::U16)),
    Object::record(0x2042, "PointRange", POINT_RANGE),
    Object::array(0x2043, "PointCommandsOfRequesters", REQUESTERS, Entry::reading("Commands", DataType::U16)),
];

const FIRST_CONFIGURATIONS: &[Object] = &first_four(&CONFIGURATIONS, 0x2001);
const FIRST_LAYOUTS: &[Object] = &first_four(&LAYOUTS, 0x2011);

/// The PDOs of a device with long images in place of those for bytes 120 to 511. Their entries are the longest that the EEPROM can
/// describe, so that it has room for all.
const LONG_OUTPUT_PDOS: &[Object] = &[
    Object::mapping(0x1604, "Outputs 120 to 509", &[by_thirty(0x2026, FIRST_BYTES, LONG_FIRST_END)]),
    Object::mapping(0x1605, "Outputs 510 to 1019", &[by_thirty(0x2026, LONG_FIRST_END, LONG_SECOND_END)]),
    Object::mapping(0x1606, "Outputs 1020 to 1499", &[by_thirty(0x2026, LONG_SECOND_END, LONG_OUTPUTS)]),
];

const LONG_INPUT_PDOS: &[Object] = &[
    STATE_PDO,
    Object::mapping(0x1a07, "Inputs 120 to 509", &[by_thirty(0x2025, FIRST_BYTES, LONG_FIRST_END)]),
    Object::mapping(0x1a08, "Inputs 510 to 1019", &[by_thirty(0x2025, LONG_FIRST_END, LONG_SECOND_END)]),
    Object::mapping(
        0x1a09,
        "Inputs 1020 to 1485",
        &[by_thirty(0x2025, LONG_SECOND_END, LONG_INPUTS), LAST_INPUTS],
    ),
];

const LONG_BUFFERS: &[Object] = &[
    Object::array(
        0x2025,
        "InputBufferByThirty",
        (LONG_INPUTS / LONG_ENTRY) as u8,
        Entry::input("Input bytes", DataType::Octets(LONG_ENTRY)),
    ),
    Object::array(
        0x2026,
        "OutputBufferByThirty",
        (LONG_OUTPUTS / LONG_ENTRY) as u8,
        Entry::output("Output bytes", DataType::Octets(LONG_ENTRY)),
    ),
    Object::variable(0x2027, Entry::input("Last input bytes", DataType::Octets(LONG_INPUTS % LONG_ENTRY))),
];

/// The complete entries of thirty bytes from `first` to `end` of a buffer.
const fn by_thirty(index: u16, first: u16, end: u16) -> Mapped {
    let (sub, count) = ((first / LONG_ENTRY) as u8 + 1, ((end - first) / LONG_ENTRY) as u8);
    Mapped { index, sub, count, bits: 8 * LONG_ENTRY as u8 }
}

/// The input bytes behind the last complete entry.
const LAST_INPUTS: Mapped =
    Mapped { index: 0x2027, sub: 0, count: 1, bits: (LONG_INPUTS % LONG_ENTRY * 8) as u8 };

/// The parts of the table, in index order.
const PARTS: &[&[Object]] = &[
    BEFORE_IDENTITY,
    &[standard::identity(IDENTITY_ENTRIES)],
    FIRST_OUTPUT_PDOS,
    OUTPUT_PDOS,
    FIRST_INPUT_PDOS,
    INPUT_PDOS,
    BEHIND_PDOS,
    FIRST_CONFIGURATIONS,
    BEFORE_LAYOUTS,
    FIRST_LAYOUTS,
    BUFFERS,
    STATES,
    BEHIND_STATES,
    &CONFIGURATIONS,
    &LAYOUTS,
    &STATUSES,
];

/// The parts of the table with long images.
const LONG_PARTS: &[&[Object]] = &[
    BEFORE_IDENTITY,
    &[standard::identity(LONG_IDENTITY_ENTRIES)],
    FIRST_OUTPUT_PDOS,
    LONG_OUTPUT_PDOS,
    FIRST_INPUT_PDOS,
    LONG_INPUT_PDOS,
    BEHIND_PDOS,
    FIRST_CONFIGURATIONS,
    BEFORE_LAYOUTS,
    FIRST_LAYOUTS,
    BUFFERS,
    LONG_BUFFERS,
    STATES,
    BEHIND_STATES,
    &CONFIGURATIONS,
    &LAYOUTS,
    &STATUSES,
];

const OBJECTS: &[Object] = &joined::<{ count(PARTS) }>(PARTS);
const LONG_OBJECTS: &[Object] = &joined::<{ count(LONG_PARTS) }>(LONG_PARTS);

pub(super) const fn count(mut parts: &[&[Object]]) -> usize {
    let mut count = 0;
    while let [part, behind @ ..] = parts {
        count += part.len();
        parts = behind;
    }
    count
}

/// Joins all `parts` into one table.
pub(super) const fn joined<const N: usize>(mut parts: &[&[Object]]) -> [Object; N] {
    let mut all = [standard::SYNC_MANAGER_TYPES; N];
    let mut free = all.as_mut_slice();
    while let [part, behind @ ..] = parts {
        // Sufficient: the count comes from the same parts.
        let Some((places, others)) = free.split_at_mut_checked(part.len()) else { break };
        places.copy_from_slice(part);
        (parts, free) = (behind, others);
    }
    all
}

/// A number from the build's environment.
///
/// # Panics
/// If it is not one; at build time.
const fn parameter(text: Option<&str>, default: u32) -> u32 {
    let Some(text) = text else { return default };
    let parsed = match text.as_bytes() {
        [b'0', b'x', ..] => u32::from_str_radix(text.split_at(2).1, 16),
        _ => u32::from_str_radix(text, 10),
    };
    match parsed {
        Ok(number) => number,
        Err(_) => panic!("a vendor id or product code is a decimal number, or 0x and hexadecimal digits"),
    }
}
