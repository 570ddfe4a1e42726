//! The port that asks Modbus devices for an EtherCAT MainDevice: `ethercat interface eth1 line bus on-loss clear`.

use heapless::String;

use crate::settings::Name;

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
