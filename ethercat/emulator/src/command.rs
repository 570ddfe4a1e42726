//! The fifteen datagram commands: addressing, action and working counter (I, EtherCAT Protocol: addressing modes, command types,
//! working counter).

use strum::{FromRepr, VariantArray};

/// A datagram's command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, FromRepr, VariantArray)]
#[repr(u8)]
#[expect(missing_docs, reason = "the names are those of the protocol")]
pub enum Command {
    Nop = 0,
    Aprd = 1,
    Apwr = 2,
    Aprw = 3,
    Fprd = 4,
    Fpwr = 5,
    Fprw = 6,
    Brd = 7,
    Bwr = 8,
    Brw = 9,
    Lrd = 10,
    Lwr = 11,
    Lrw = 12,
    Armw = 13,
    Frmw = 14,
}

/// How a datagram addresses devices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Addressing {
    /// No device.
    None,
    /// The device that sees position 0; each device increments it.
    Position,
    /// The device with this configured station address.
    Station,
    /// Every device.
    Broadcast,
    /// Every device that maps the logical address.
    Logical,
}

/// What an addressed device does with its memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Action {
    /// Reads its memory into the datagram.
    pub read: bool,
    /// Writes the datagram into its memory.
    pub write: bool,
    /// ORs what it reads onto the data instead of replacing them.
    pub or: bool,
}

impl Action {
    const NONE: Self = Self { read: false, write: false, or: false };
    const READ: Self = Self { read: true, ..Self::NONE };
    const WRITE: Self = Self { write: true, ..Self::NONE };
    const BOTH: Self = Self { read: true, write: true, or: false };

    /// Increment of the working counter if `read` or `written` succeeded for at least one bit.
    pub fn counts(self, read: bool, written: bool) -> u16 {
        let write_counts = if self.read { 2 } else { 1 };
        u16::from(self.read && read) + if self.write && written { write_counts } else { 0 }
    }
}

impl Command {
    /// How it addresses devices.
    pub fn addressing(self) -> Addressing {
        match self {
            Self::Nop => Addressing::None,
            Self::Aprd | Self::Apwr | Self::Aprw | Self::Armw => Addressing::Position,
            Self::Fprd | Self::Fpwr | Self::Fprw | Self::Frmw => Addressing::Station,
            Self::Brd | Self::Bwr | Self::Brw => Addressing::Broadcast,
            Self::Lrd | Self::Lwr | Self::Lrw => Addressing::Logical,
        }
    }

    /// A device's action: for ARMW and FRMW the `addressed` device reads, all others write.
    pub fn action(self, addressed: bool) -> Action {
        match self {
            Self::Armw | Self::Frmw if addressed => Action::READ,
            Self::Armw | Self::Frmw => Action::WRITE,
            _ if !addressed => Action::NONE,
            Self::Nop => Action::NONE,
            Self::Aprd | Self::Fprd | Self::Lrd => Action::READ,
            Self::Apwr | Self::Fpwr | Self::Bwr | Self::Lwr => Action::WRITE,
            Self::Aprw | Self::Fprw | Self::Lrw => Action::BOTH,
            Self::Brd => Action { or: true, ..Action::READ },
            Self::Brw => Action { or: true, ..Action::BOTH },
        }
    }
}
