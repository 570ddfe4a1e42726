//! Why a configuration cannot be used, or not be kept.

use ethercat_subdevice::al_state::AlStatusCode;

use crate::scanner::Kind;

/// Why a configuration cannot be used, or not be kept. Slaves count from 0, as in the names of 2001h to 2004h.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ConfigError {
    /// The values that are read are longer than the assigned PDOs.
    #[error("slave {slave} ends past the {room} input bytes")]
    InputsFull {
        /// The first one for which there is no room.
        slave: u8,
        /// Bytes that there are.
        room: u16,
    },
    /// The values that are written are longer than the assigned PDOs.
    #[error("slave {slave} ends past the {room} output bytes")]
    OutputsFull {
        /// The first one for which there is no room.
        slave: u8,
        /// Bytes that there are.
        room: u16,
    },
    /// The assigned PDOs are longer than the memory of the controller (0006h).
    #[error("the controller holds {room} of {bytes} {values} bytes")]
    MemoryFull {
        /// `input` or `output`.
        values: &'static str,
        /// Bytes of the assigned PDOs.
        bytes: u16,
        /// Bytes that the controller has for them.
        room: u16,
    },
    /// A kind's addresses would go past 65535.
    #[error("slave {slave}: {kind} addresses past 65535")]
    PastLastAddress {
        /// The slave.
        slave: u8,
        /// What it should have there.
        kind: Kind,
    },
    /// Registers that a value of 32 bits takes only half of.
    #[error("slave {slave}: half a value of {kind}")]
    HalfValue {
        /// The slave.
        slave: u8,
        /// Where.
        kind: Kind,
    },
    /// More than a PDO can list.
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
    /// Modules stay as long as process data are exchanged.
    #[error("the modules are in use by the MainDevice")]
    ModulesInUse,
    /// Bits per character and parity that are no character of Modbus RTU.
    #[error("2020h: {bits} bits with parity {parity} are not RTU")]
    Character {
        /// Bits of a character, the parity bit among them.
        bits: u8,
        /// The parity mode.
        parity: u8,
    },
    /// No port asks Modbus devices for the MainDevice.
    #[error("no ethercat port is set")]
    NoPort,
    /// The port's line is not there, or is none whose format can be set.
    #[error("the ethercat port's line is no RTU client")]
    NoLine,
    /// What is not in use is not saved.
    #[error("no configuration is in use")]
    NotInUse,
    /// Nobody has a store for settings.
    #[error("there is no place to save settings")]
    NoStore,
    /// The store for settings failed.
    #[error("the settings could not be saved")]
    NotSaved,
}

impl ConfigError {
    /// The code by which SafeOp is refused.
    pub(super) const fn al_status(self) -> AlStatusCode {
        match self {
            Self::InputsFull { .. } => AlStatusCode::InvalidInputMapping,
            Self::OutputsFull { .. } => AlStatusCode::InvalidOutputMapping,
            Self::OtherModule { .. } => AlStatusCode::ModulesDiffer,
            _ => AlStatusCode::InconsistentSettings,
        }
    }
}
