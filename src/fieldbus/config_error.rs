//! Why a configuration cannot be used or saved.

use ethercat_subdevice::al_state::AlStatusCode;

use crate::scanner::Kind;

/// Why a configuration cannot be used or saved. Slaves count from 0, as in the names of 2001h to 2004h.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ConfigError {
    /// The values to read exceed the assigned PDOs.
    #[error("slave {slave} ends past the {room} input bytes")]
    InputsFull {
        /// The first slave that does not fit.
        slave: u8,
        /// Available bytes.
        room: u16,
    },
    /// The values to write exceed the assigned PDOs.
    #[error("slave {slave} ends past the {room} output bytes")]
    OutputsFull {
        /// The first slave that does not fit.
        slave: u8,
        /// Available bytes.
        room: u16,
    },
    /// The assigned PDOs exceed the controller's memory (0006h).
    #[error("the controller holds {room} of {bytes} {values} bytes")]
    MemoryFull {
        /// `input` or `output`.
        values: &'static str,
        /// Bytes of the assigned PDOs.
        bytes: u16,
        /// Bytes available in the controller.
        room: u16,
    },
    /// Addresses of a table exceed 65535.
    #[error("slave {slave}: {kind} addresses past 65535")]
    PastLastAddress {
        /// The slave.
        slave: u8,
        /// The table.
        kind: Kind,
    },
    /// An odd number of registers for 32-bit values.
    #[error("slave {slave}: half a value of {kind}")]
    HalfValue {
        /// The slave.
        slave: u8,
        /// The table.
        kind: Kind,
    },
    /// More entries than a PDO can list.
    #[error("slave {slave}: over 254 entries in a PDO")]
    EntriesFull {
        /// The slave.
        slave: u8,
    },
    /// Not the module that the MainDevice expects in its slot (F030h).
    #[error("slot {slave}: not the module that is expected")]
    OtherModule {
        /// The slave.
        slave: u8,
    },
    /// Modules cannot change while process data are exchanged.
    #[error("the modules are in use by the MainDevice")]
    ModulesInUse,
    /// Bits per character and parity that Modbus RTU does not allow.
    #[error("2020h: {bits} bits with parity {parity} are not RTU")]
    Character {
        /// Bits of a character, including the parity bit.
        bits: u8,
        /// The parity mode.
        parity: u8,
    },
    /// No port polls Modbus devices for the MainDevice.
    #[error("no ethercat port is set")]
    NoPort,
    /// The port's line does not exist, or has no configurable format.
    #[error("the ethercat port's line is no RTU client")]
    NoLine,
    /// Only a configuration in use can be saved.
    #[error("no configuration is in use")]
    NotInUse,
    /// There is no store for settings.
    #[error("there is no place to save settings")]
    NoStore,
    /// The store for settings failed.
    #[error("the settings could not be saved")]
    NotSaved,
}

impl ConfigError {
    /// The AL status code for the refusal of SafeOp.
    pub(super) const fn al_status(self) -> AlStatusCode {
        match self {
            Self::InputsFull { .. } => AlStatusCode::InvalidInputMapping,
            Self::OutputsFull { .. } => AlStatusCode::InvalidOutputMapping,
            Self::OtherModule { .. } => AlStatusCode::ModulesDiffer,
            _ => AlStatusCode::InconsistentSettings,
        }
    }
}
