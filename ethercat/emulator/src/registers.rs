//! The register map: names, and each side's write permissions (in the order of II).

use std::ops::RangeInclusive;

macro_rules! registers {
    ($($(#[$doc:meta])* $name:ident = $address:literal;)*) => {
        $($(#[$doc])* pub const $name: u16 = $address;)*
    };
}

registers! {
    /// Type, revision, build, numbers of FMMUs and SyncManagers, memory, ports, features.
    TYPE = 0x0000;
    /// Configured station address.
    STATION = 0x0010;
    /// Station alias, from the EEPROM.
    ALIAS = 0x0012;
    /// Reset by the MainDevice: three magic bytes.
    ECAT_RESET = 0x0040;
    /// Reset by the processor: three magic bytes.
    PDI_RESET = 0x0041;
    /// DL control.
    DL_CONTROL = 0x0100;
    /// DL status.
    DL_STATUS = 0x0110;
    /// AL control.
    AL_CONTROL = 0x0120;
    /// AL status.
    AL_STATUS = 0x0130;
    /// AL status code.
    AL_STATUS_CODE = 0x0134;
    /// PDI control and ESC configuration.
    PDI_CONTROL = 0x0140;
    /// PDI configuration and SYNC/LATCH configuration.
    PDI_CONFIG = 0x0150;
    /// ECAT event mask.
    ECAT_EVENT_MASK = 0x0200;
    /// AL event mask.
    AL_EVENT_MASK = 0x0204;
    /// ECAT event request.
    ECAT_EVENT = 0x0210;
    /// AL event request.
    AL_EVENT = 0x0220;
    /// Error counters of the ports, forwarded errors, processing unit, PDI.
    ERROR_COUNTERS = 0x0300;
    /// Frames rejected by the processing unit.
    PROCESSING_ERRORS = 0x030C;
    /// Lost link counters.
    LOST_LINK = 0x0310;
    /// Watchdog divider.
    WATCHDOG_DIVIDER = 0x0400;
    /// Watchdog time of the PDI.
    WATCHDOG_PDI = 0x0410;
    /// Watchdog time of the process data.
    WATCHDOG_DATA = 0x0420;
    /// Watchdog status of the process data.
    WATCHDOG_STATUS = 0x0440;
    /// Watchdog counters: process data, PDI.
    WATCHDOG_COUNTERS = 0x0442;
    /// Assignment of the EEPROM interface.
    EEPROM_CONFIG = 0x0500;
    /// Whether the processor uses the EEPROM interface.
    EEPROM_PDI = 0x0501;
    /// EEPROM control and status.
    EEPROM_CONTROL = 0x0502;
    /// EEPROM word address.
    EEPROM_ADDRESS = 0x0504;
    /// EEPROM data.
    EEPROM_DATA = 0x0508;
    /// The first FMMU; 16 bytes each.
    FMMU = 0x0600;
    /// The first SyncManager; 8 bytes each.
    SYNC_MANAGER = 0x0800;
    /// Receive times of the ports; a write latches them.
    RECEIVE_TIMES = 0x0900;
    /// System time.
    SYSTEM_TIME = 0x0910;
    /// Receive time of the processing unit.
    RECEIVE_TIME_UNIT = 0x0918;
    /// System time offset.
    TIME_OFFSET = 0x0920;
    /// Transmission delay.
    TIME_DELAY = 0x0928;
    /// System time difference.
    TIME_DIFFERENCE = 0x092C;
    /// Speed counter start; a write resets the control loop.
    SPEED_START = 0x0930;
    /// Filter depths of the control loop.
    FILTERS = 0x0934;
    /// Assignment of the SYNC unit.
    SYNC_UNIT = 0x0980;
    /// SYNC activation.
    SYNC_ACTIVATION = 0x0981;
    /// Length of a SYNC pulse, in 10 ns; 0 waits for acknowledgement.
    PULSE_LENGTH = 0x0982;
    /// Whether SYNC signals are pending.
    SYNC_STATUS = 0x0984;
    /// State of SYNC0; reading acknowledges.
    SYNC0_STATUS = 0x098E;
    /// State of SYNC1; reading acknowledges.
    SYNC1_STATUS = 0x098F;
    /// Start time of the cyclic operation, then time of the next SYNC0 pulse.
    START_TIME = 0x0990;
    /// Time of the next SYNC1 pulse.
    NEXT_SYNC1 = 0x0998;
    /// SYNC0 cycle.
    SYNC0_CYCLE = 0x09A0;
    /// Time from a SYNC0 pulse to the SYNC1 pulse.
    SYNC1_CYCLE = 0x09A4;
    /// Modes of LATCH0; LATCH1 is next.
    LATCH_CONTROL = 0x09A8;
    /// Events and level of LATCH0; LATCH1 is next.
    LATCH_STATUS = 0x09AE;
    /// Times of edges: LATCH0 rising, falling, LATCH1 rising, falling.
    LATCH_TIMES = 0x09B0;
    /// User memory among the registers.
    USER_RAM = 0x0F80;
    /// The first byte of process data memory.
    PROCESS_RAM = 0x1000;
}

/// Registers that the MainDevice may always write.
const ECAT_WRITES: [RangeInclusive<u16>; 19] = [
    0x0010..=0x0011,
    0x0040..=0x0040,
    0x0100..=0x0103,
    0x0108..=0x0109,
    0x0200..=0x0201,
    0x0300..=0x0313,
    0x0400..=0x0401,
    0x0410..=0x0411,
    0x0420..=0x0421,
    0x0442..=0x0443,
    0x0500..=0x0500,
    0x0900..=0x0903,
    0x0910..=0x0917,
    0x0920..=0x092B,
    0x0930..=0x0931,
    0x0934..=0x0935,
    0x0980..=0x0980,
    0x0F00..=0x0F03,
    0x0F80..=0x0FFF,
];

/// Registers that the processor may always write.
const PDI_WRITES: [RangeInclusive<u16>; 7] = [
    0x0012..=0x0013,
    0x0041..=0x0041,
    0x0130..=0x0131,
    0x0134..=0x0135,
    0x0138..=0x0139,
    0x0204..=0x0207,
    0x0F80..=0x0FFF,
];

/// The SYNC unit's registers, assigned by register 0980h bit 0.
const SYNC_WRITES: [RangeInclusive<u16>; 3] = [0x0981..=0x0981, 0x0990..=0x0997, 0x09A0..=0x09A7];

fn among(ranges: &[RangeInclusive<u16>], address: u16) -> bool {
    ranges.iter().any(|range| range.contains(&address))
}

pub(crate) fn ecat_writes(address: u16) -> bool {
    among(&ECAT_WRITES, address)
}

pub(crate) fn pdi_writes(address: u16) -> bool {
    among(&PDI_WRITES, address)
}

pub(crate) fn sync_writes(address: u16) -> bool {
    among(&SYNC_WRITES, address)
}
