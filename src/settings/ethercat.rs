//! The port that polls Modbus devices for an EtherCAT MainDevice: `ethercat interface eth1 line bus on-loss clear`.

use heapless::String;

use crate::settings::Name;

/// Longest name of a network interface on Linux (IFNAMSIZ, less the terminating zero).
pub(crate) const INTERFACE_BYTES_MAX: usize = 15;

/// The name of a network interface: `eth1`.
pub type InterfaceName = String<INTERFACE_BYTES_MAX>;

/// Settings of the EtherCAT port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EthercatSettings {
    /// The network interface at which the gateway is a SubDevice; `None` on boards with a controller chip.
    pub interface: Option<InterfaceName>,
    /// Handling of outputs when the MainDevice stops sending them.
    pub on_loss: OnLoss,
    /// The RTU client whose speed and format the MainDevice sets, if any.
    pub line: Option<Name>,
    /// Outputs are read from the controller until two reads agree, for an SPI with bit errors: adds about half of the traffic.
    pub prove_outputs: bool,
    /// Distinguishes gateways from each other, like a rotary switch; `None`: the station alias in the EEPROM.
    pub id: Option<u16>,
    /// Errors are also reported as emergencies; a MainDevice can change that (10F3h:05). Some MainDevices stop at the first one.
    pub emergencies: bool,
    /// The SubDevice is a modular one (ETG.5001): each slave is a module in a slot, with typed values.
    pub modules: bool,
    /// What a MainDevice may do with the named files. Images without them have no word for it.
    pub(crate) files: FileRights,
    /// The network interface that carries a MainDevice's Ethernet frames (EoE), if any.
    #[cfg(feature = "eoe")] // As its word.
    pub ethernet: Option<InterfaceName>,
    /// No value where there is no EtherCAT: the compiler leaves out what is done with these settings.
    pub(crate) exists: Exists,
}

// See `EthercatSettings::exists`; also below.
#[cfg(feature = "points")]
type Exists = ();
#[cfg(feature = "points")]
const EXISTS: Option<Exists> = Some(());
#[cfg(not(feature = "points"))]
type Exists = core::convert::Infallible;
#[cfg(not(feature = "points"))]
const EXISTS: Option<Exists> = None;

impl EthercatSettings {
    /// The defaults, in an image with EtherCAT.
    pub(crate) fn new() -> Option<Self> {
        EXISTS.map(|exists| Self {
            interface: None,
            on_loss: OnLoss::Stop,
            line: None,
            prove_outputs: false,
            id: None,
            emergencies: false,
            modules: false,
            files: FileRights::Off,
            #[cfg(feature = "eoe")] // As its word.
            ethernet: None,
            exists,
        })
    }

    /// Whether a MainDevice's Ethernet frames are carried.
    pub(crate) fn has_ethernet(&self) -> bool {
        #[cfg(feature = "eoe")] // As its word.
        return self.ethernet.is_some();
        #[cfg(not(feature = "eoe"))]
        false
    }
}

/// Handling of the devices' outputs when the MainDevice leaves Op, or its watchdog expires.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OnLoss {
    /// No more writes.
    #[default]
    Stop,
    /// The last outputs stay in force, and are rewritten to a device with other values.
    Hold,
    /// All become 0.
    Clear,
}

/// What a MainDevice may do with the gateway's files: settings, log and capture.
// As the word.
#[cfg_attr(not(feature = "files"), allow(dead_code))]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FileRights {
    /// Nothing.
    Off,
    /// Read them.
    Read,
    /// Also write the settings.
    Write,
}
