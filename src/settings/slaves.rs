//! The Modbus devices behind the EtherCAT process image, in the order of their values there.

use crate::scanner::{ByteOrder, Form, Kind, POINTS, ValueType};

/// Most devices behind the process image.
pub(crate) const SLAVES_MAX: usize = if POINTS { 32 } else { 0 };

/// Default polling period of a device.
pub(crate) const POLLING_MS: u32 = 1_000;

/// Contiguous cells of one table of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Cells {
    /// Number of cells.
    pub count: u16,
    /// The first address, as on the wire.
    pub address: u16,
}

/// Substitute values for the inputs of a device that does not respond.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum OnSilence {
    /// They keep the values read last.
    #[default]
    Hold = 0,
    /// All become 0.
    Clear = 1,
    /// Each register becomes [`SlaveSettings::substitute`], and each bit its lowest one.
    Substitute = 2,
}

impl OnSilence {
    /// The resulting state of the inputs, after a comma.
    #[cfg(feature = "points")] // As the view of points.
    pub(crate) const fn of_inputs(self) -> &'static str {
        match self {
            Self::Hold => ", inputs held",
            Self::Clear => ", inputs cleared",
            Self::Substitute => ", inputs substituted",
        }
    }
}

/// One device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SlaveSettings {
    /// Its unit id.
    pub unit: u8,
    /// Check for a sign of life before each poll.
    pub check: bool,
    /// Handling of its inputs when it does not respond.
    pub on_silence: OnSilence,
    /// The value of substituted inputs.
    pub substitute: u16,
    /// Polling period in milliseconds.
    pub polling_ms: u32,
    /// Its cells, in the order of [`Kind::ALL`].
    pub cells: [Cells; 4],
    /// The types of its input registers and its holding registers.
    pub types: [ValueType; 2],
    /// The byte order of its values of several registers.
    pub order: ByteOrder,
}

impl SlaveSettings {
    /// The device `unit` without cells.
    pub const fn new(unit: u8) -> Self {
        let cells = [Cells { count: 0, address: 0 }; 4];
        let on_silence = OnSilence::Hold;
        let (types, order) = ([ValueType::U16; 2], ByteOrder::Order0123);
        Self { unit, check: false, on_silence, substitute: 0, polling_ms: POLLING_MS, cells, types, order }
    }

    /// The type of a table's values.
    pub const fn value_type(&self, kind: Kind) -> ValueType {
        let [input, holding] = self.types;
        match kind {
            Kind::Coil | Kind::Discrete => ValueType::Bit,
            Kind::Input => input,
            Kind::Holding => holding,
        }
    }

    /// The form in memory: values with the high byte first.
    pub const fn form(&self, kind: Kind) -> Form {
        self.value_type(kind).form()
    }

    /// The tables with their configured cells.
    pub fn tables(&self) -> impl Iterator<Item = (Kind, Cells)> {
        Kind::ALL.into_iter().zip(self.cells)
    }

    /// The value that replaces its inputs when it does not respond.
    pub const fn filling(&self) -> Option<u16> {
        match self.on_silence {
            OnSilence::Hold => None,
            OnSilence::Clear => Some(0),
            OnSilence::Substitute => Some(self.substitute),
        }
    }
}
