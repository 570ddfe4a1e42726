//! The gateway's object dictionary: the one table that SDO, the EEPROM and the ESI file are made from.
//!
//! Vendor id and product code are parameters of the build, the variables `MOBGATE_ETHERCAT_VENDOR` and
//! `MOBGATE_ETHERCAT_PRODUCT` (decimal or `0x`): a vendor id is assigned by the EtherCAT Technology Group. The default is nobody's, for
//! evaluation only.

use crate::ethercat::device::{Device, Identity};
use crate::ethercat::object::{Access, DataType, Entry, Mapped, Object};
use crate::ethercat::standard;
use crate::ethercat::sync_manager::MemoryPlan;

/// Modbus devices that can be configured.
pub const MODBUS_DEVICES_MAX: usize = 4;
/// Bytes of the input buffer and of the output buffer.
pub const IMAGE_BYTES: usize = 120;
/// Bytes of the reason for which a configuration is refused (2006h).
pub const REASON_BYTES: u16 = 48;
/// Entries of the buffers when they are taken eight bytes at a time.
const IMAGE_WORDS: u8 = (IMAGE_BYTES / 8) as u8;

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
    // A LAN9252 has 4 KiB of process memory. The eight bytes more of inputs are for the status.
    memory: MemoryPlan::new(128, IMAGE_BYTES as u16, IMAGE_BYTES as u16 + 8, 4096),
    // LAN9252: SPI, no synchronisation signals.
    controller: [0x80, 0, 0, 0, 0, 0, 0, 0],
    // Some MainDevices (ethercrab 0.7) end with the first one that they get.
    emergencies: false,
    objects: OBJECTS,
};

const ANY_U16: (u64, u64) = (0, u16::MAX as u64);

const MODBUS: &[Entry] =
    &[Entry::setting("NumSlave", DataType::U16, MODBUS_DEVICES_MAX as u64, (0, MODBUS_DEVICES_MAX as u64))];

const fn modbus_device(id: u64) -> [Entry; 10] {
    [
        Entry::setting("Id", DataType::U16, id, (1, 247)),
        Entry::setting("NumCoils", DataType::U16, 0, ANY_U16),
        Entry::setting("CoilsAddress", DataType::U16, 0, ANY_U16),
        Entry::setting("NumSwitches", DataType::U16, 0, ANY_U16),
        Entry::setting("SwitchesAddress", DataType::U16, 0, ANY_U16),
        Entry::setting("NumInRegisters", DataType::U16, 0, ANY_U16),
        Entry::setting("InRegistersAddress", DataType::U16, 0, ANY_U16),
        Entry::setting("NumOutRegisters", DataType::U16, 0, ANY_U16),
        Entry::setting("OutRegistersAddress", DataType::U16, 0, ANY_U16),
        Entry::setting("PollingTimeMs", DataType::U32, 1_000, (1, 3_600_000)),
    ]
}

const MODBUS_DEVICE_0: &[Entry] = &modbus_device(1);
const MODBUS_DEVICE_1: &[Entry] = &modbus_device(2);
const MODBUS_DEVICE_2: &[Entry] = &modbus_device(3);
const MODBUS_DEVICE_3: &[Entry] = &modbus_device(4);

const FLAGS: &[Entry] = &[
    Entry::setting("ConfigUpdateFlag", DataType::U16, 0, (0, 1)),
    // The gateway sets it, a MainDevice can only reset it.
    Entry::setting("ConfigUpdateCompletedFlag", DataType::U16, 0, (0, 0)),
];

const LAYOUT: &[Entry] = &[
    Entry::reading("StartInput", DataType::U16),
    Entry::reading("InputCoils", DataType::U16),
    Entry::reading("InputSwitches", DataType::U16),
    Entry::reading("InputInRegisters", DataType::U16),
    Entry::reading("InputOutRegisters", DataType::U16),
    Entry::reading("EndInput", DataType::U16),
    Entry::reading("StartOutput", DataType::U16),
    Entry::reading("OutputCoils", DataType::U16),
    Entry::reading("OutputOutRegisters", DataType::U16),
    Entry::reading("EndOutput", DataType::U16),
];

const UART: &[Entry] = &[
    Entry::setting("BaudRate", DataType::U32, 115_200, (1_200, 4_000_000)),
    Entry::setting("BitCountPerChar", DataType::U16, 0, (0, 1)),
    Entry::setting("ParityMode", DataType::U16, 0, (0, 3)),
    Entry::setting("StopBitCount", DataType::U16, 0, (0, 1)),
];

const STATUS: &[Entry] =
    &[Entry::reading("InputCounter", DataType::U8).with_access(Access::READ.and(Access::TX_PDO))];

const CHECK: Entry = Entry::setting("CheckBeforePoll", DataType::U8, 0, (0, 1));

/// 0: not asked yet; 1: well; 2: not normal.
const HEALTH: Entry = Entry::reading("Health", DataType::U8).with_access(Access::READ.and(Access::TX_PDO));

const DEVICE_STATUS: &[Entry] = &[
    HEALTH,
    // Never, until it does.
    Entry::reading("AnsweredBeforeMs", DataType::U32).with_default(u32::MAX as u64),
    Entry::reading("ExceptionCode", DataType::U8),
    Entry::reading("LastError", DataType::U8),
    Entry::reading("Requests", DataType::U32),
    Entry::reading("Answers", DataType::U32),
    Entry::reading("Exceptions", DataType::U32),
    Entry::reading("Failures", DataType::U32),
];

const fn inputs(data_type: DataType) -> Entry {
    Entry::reading("Input", data_type).with_access(Access::READ.and(Access::TX_PDO))
}

const fn outputs(data_type: DataType) -> Entry {
    Entry::reading("Output", data_type).with_access(Access::READ.and(Access::RX_PDO))
}

const fn all_of(index: u16, count: u8, bits: u8) -> Mapped {
    Mapped { index, sub: 1, count, bits }
}

const IDENTITY_ENTRIES: &[Entry] = &standard::identity_entries(IDENTITY);

const OBJECTS: &[Object] = &[
    standard::device_type(0x0000_1389),
    standard::device_name("mobgate EtherCAT to Modbus gateway"),
    standard::hardware_version("1"),
    standard::software_version(env!("CARGO_PKG_VERSION")),
    standard::identity(IDENTITY_ENTRIES),
    Object::mapping(0x1600, "Outputs by byte", &[all_of(0x2022, IMAGE_BYTES as u8, 8)]),
    Object::mapping(0x1601, "Outputs by eight bytes", &[all_of(0x2024, IMAGE_WORDS, 64)]),
    Object::mapping(0x1a00, "Inputs by byte", &[all_of(0x2021, IMAGE_BYTES as u8, 8)]),
    Object::mapping(0x1a01, "Inputs by eight bytes", &[all_of(0x2023, IMAGE_WORDS, 64)]),
    Object::mapping(0x1a02, "Status", &[all_of(0x2030, 1, 8)]),
    Object::mapping(0x1a03, "Health of the devices", &[all_of(0x2031, MODBUS_DEVICES_MAX as u8, 8)]),
    standard::SYNC_MANAGER_TYPES,
    standard::rx_assignment(&[0x1600], standard::SELECTABLE),
    standard::tx_assignment(&[0x1a00], standard::SELECTABLE),
    standard::OUTPUT_SYNCHRONISATION,
    standard::INPUT_SYNCHRONISATION,
    Object::record(0x2000, "ModbusConfig", MODBUS),
    Object::record(0x2001, "ModbusConfigSlave0", MODBUS_DEVICE_0),
    Object::record(0x2002, "ModbusConfigSlave1", MODBUS_DEVICE_1),
    Object::record(0x2003, "ModbusConfigSlave2", MODBUS_DEVICE_2),
    Object::record(0x2004, "ModbusConfigSlave3", MODBUS_DEVICE_3),
    Object::record(0x2005, "ConfigUpdateAndCompletedFlag", FLAGS),
    Object::variable(0x2006, Entry::reading("ConfigRefusedBecause", DataType::Text(REASON_BYTES))),
    Object::array(0x2007, "CheckBeforePollSlaves", MODBUS_DEVICES_MAX as u8, CHECK),
    Object::record(0x2011, "PhyAddressRegistersModbusSlave0", LAYOUT),
    Object::record(0x2012, "PhyAddressRegistersModbusSlave1", LAYOUT),
    Object::record(0x2013, "PhyAddressRegistersModbusSlave2", LAYOUT),
    Object::record(0x2014, "PhyAddressRegistersModbusSlave3", LAYOUT),
    Object::record(0x2020, "UartConfigUart1", UART),
    Object::array(0x2021, "InputBuffer", IMAGE_BYTES as u8, inputs(DataType::U8)),
    Object::array(0x2022, "OutputBuffer", IMAGE_BYTES as u8, outputs(DataType::U8)),
    Object::array(0x2023, "InputBufferByEight", IMAGE_WORDS, inputs(DataType::U64)),
    Object::array(0x2024, "OutputBufferByEight", IMAGE_WORDS, outputs(DataType::U64)),
    Object::record(0x2030, "Status", STATUS),
    Object::array(0x2031, "HealthOfSlaves", MODBUS_DEVICES_MAX as u8, HEALTH),
    Object::record(0x2180, "StatusModbusSlave0", DEVICE_STATUS),
    Object::record(0x2181, "StatusModbusSlave1", DEVICE_STATUS),
    Object::record(0x2182, "StatusModbusSlave2", DEVICE_STATUS),
    Object::record(0x2183, "StatusModbusSlave3", DEVICE_STATUS),
];

/// A number from the build's environment.
///
/// # Panics
/// At build time, when it is not one.
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
