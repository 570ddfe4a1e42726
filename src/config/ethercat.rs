//! The port that asks Modbus devices for an EtherCAT MainDevice: `ethercat interface eth1 line bus on-loss clear`.

use core::fmt::{self, Display};

use heapless::String;

use super::{Framing, LineSettings, Name, PortId, PortKind, SerialSettings, Settings, Side};

/// Longest name of a network interface, as Linux has it (IFNAMSIZ, less the zero at its end).
pub const INTERFACE_BYTES_MAX: usize = 15;

/// The name of a network interface: `eth1`.
pub type InterfaceName = String<INTERFACE_BYTES_MAX>;

/// How the process image meets the Modbus devices.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct EthercatSettings {
    /// The network interface at which the gateway is a SubDevice; none where the controller is a chip of the board.
    pub interface: Option<InterfaceName>,
    /// What becomes of outputs when the MainDevice sends none any more.
    pub on_loss: OnLoss,
    /// The RTU client whose speed and format the MainDevice sets; none: it sets none.
    pub line: Option<Name>,
    /// Outputs are read from the controller until two readings agree, for an SPI that may turn bits: about half as much traffic again.
    pub prove_outputs: bool,
    /// What tells the gateway from others of its kind, as a rotary switch would; none: the station alias in the EEPROM.
    pub id: Option<u16>,
    /// Errors are reported by emergencies, too; a MainDevice can change that (10F3h:05). Some end with the first one they get.
    pub emergencies: bool,
    /// The SubDevice is a modular one (ETG.5001): each slave is a module in a slot, with typed values.
    pub modules: bool,
}

impl Settings {
    /// How the EtherCAT port is set, if there is one.
    pub fn ethercat(&self) -> Option<&EthercatSettings> {
        self.ports.iter().flatten().find_map(|port| match &port.kind {
            PortKind::Ethercat(settings) => Some(settings),
            _ => None,
        })
    }

    /// The line whose speed and format the MainDevice sets, if it is there.
    pub fn ethercat_line(&self) -> Option<PortId> {
        let id = self.find(self.ethercat()?.line.as_ref()?)?;
        let is_rtu_client = matches!(
            self.port(id)?.kind,
            PortKind::Serial(SerialSettings { framing: Framing::Rtu, side: Side::Client, .. })
        );
        is_rtu_client.then_some(id)
    }

    /// How that line is set.
    pub(crate) fn ethercat_speed(&self) -> Option<&LineSettings> {
        match &self.port(self.ethercat_line()?)?.kind {
            PortKind::Serial(serial) => Some(&serial.line),
            _ => None,
        }
    }
}

/// What becomes of the devices' outputs when the MainDevice leaves Op, or its watchdog runs out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OnLoss {
    /// Nothing is written any more.
    #[default]
    Stop,
    /// The last ones stay in force: a device that has others gets them again.
    Hold,
    /// All become 0.
    Clear,
}

pub(super) const ON_LOSS: &[(&str, OnLoss)] =
    &[("hold", OnLoss::Hold), ("clear", OnLoss::Clear), ("stop", OnLoss::Stop)];

impl Display for OnLoss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Hold => "hold",
            Self::Clear => "clear",
            Self::Stop => "stop",
        })
    }
}
