//! Checks whether a board can run given settings.

use super::Gateway;
use crate::fieldbus::ConfigError;
use crate::scanner::Full;
use crate::settings::{Name, Port, PortKind, Settings, StreamFraming};

/// Why settings were rejected.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ApplyError {
    /// The TCP servers need more connections than the board has.
    #[error(
        "the TCP servers need {wanted} connections (one more each than their clients), this board has {connections}"
    )]
    Connections {
        /// Connections needed.
        wanted: usize,
        /// Connections available.
        connections: usize,
    },
    /// Two ports use the same line under different names.
    #[error("ports {one} and {other} are on the same device")]
    SameDevice {
        /// The first port.
        one: Name,
        /// The second one.
        other: Name,
    },
    /// The board's network does not belong to the gateway.
    #[error("network lines are for boards with a network of their own; here the operating system manages it")]
    Network,
    /// An operating system keeps the time.
    #[error("ntp lines are for boards with a network of their own; here the operating system keeps the time")]
    Time,
    /// The board runs fewer ports.
    #[error("this board runs {0} ports at most")]
    Ports(usize),
    /// The board has no memory for data points.
    #[error("this board has no data points")]
    NoPoints,
    /// The board has no EtherCAT controller.
    #[error("this board has no EtherCAT controller: it cannot have an ethercat port")]
    NoEthercat,
    /// The board has no controller, but can emulate one at a network interface.
    #[error(
        "there is no EtherCAT controller here; name the network interface to be a SubDevice at: interface eth1"
    )]
    NoInterface,
    /// The board has a controller.
    #[error("the EtherCAT controller is wired to this board: there is no network interface to choose")]
    WiredController,
    /// The board has no memory for a capture.
    #[error("this board has no capture")]
    NoCapture,
    /// The data points exceed the scanner's capacity.
    #[error(transparent)]
    Points(#[from] Full),
    /// The slaves of the EtherCAT port are invalid.
    #[error(transparent)]
    Slaves(#[from] ConfigError),
}

impl ApplyError {
    /// The word to report in the line that needs what the board lacks; it may also come from another line.
    pub(crate) fn word<'s>(&self, settings: &'s Settings) -> &'s str {
        match self {
            Self::Network => "network",
            Self::Time => "ntp",
            Self::Connections { .. } => "clients",
            Self::NoPoints => "scanner",
            Self::NoEthercat | Self::NoInterface => "ethercat",
            Self::WiredController => {
                let names = settings.ethercat().is_some_and(|port| port.interface.is_some());
                if names { "interface" } else { "ethernet" }
            }
            Self::NoCapture => "capture",
            Self::SameDevice { other, .. } => {
                let port = settings.find(other).and_then(|id| settings.port(id));
                port.and_then(device).unwrap_or_default()
            }
            Self::Ports(_) | Self::Points(_) | Self::Slaves(_) => "",
        }
    }
}

impl Gateway<'_> {
    /// Whether the board can run `new`.
    pub(crate) fn check(&self, new: &Settings) -> Result<(), ApplyError> {
        let wanted = new.ports.iter().flatten().map(|port| port.kind.connections()).sum();
        if wanted > self.connections.len() {
            return Err(ApplyError::Connections { wanted, connections: self.connections.len() });
        }
        if new.ports.iter().skip(self.ports.len()).any(Option::is_some) {
            return Err(ApplyError::Ports(self.ports.len()));
        }
        if !self.owns_network && new.network.is_some() {
            return Err(ApplyError::Network);
        }
        if !self.owns_network && new.ntp().is_some() {
            return Err(ApplyError::Time);
        }
        let has_points = !new.points.is_empty() || new.ports.iter().flatten().any(is_scanner);
        if has_points && self.scanner().is_none() {
            return Err(ApplyError::NoPoints);
        }
        if let Some(port) = new.ethercat() {
            match (self.ethercat(), self.ethercat_interfaces, &port.interface) {
                (None, _, _) => return Err(ApplyError::NoEthercat),
                (_, true, None) => return Err(ApplyError::NoInterface),
                (_, false, Some(_)) => return Err(ApplyError::WiredController),
                (_, false, None) if port.has_ethernet() => return Err(ApplyError::WiredController),
                _ => {}
            }
        }
        if let Some(ethercat) = self.ethercat() {
            ethercat.check_settings(new)?;
        }
        if new.ports.iter().flatten().any(captures) && self.capture().is_none() {
            return Err(ApplyError::NoCapture);
        }
        self.check_devices(new)
    }

    /// Whether two names are the same serial line.
    pub(crate) fn is_same_device(&self, one: &str, other: &str) -> bool {
        (self.same_device)(one, other)
    }

    /// Fails if two ports use the same serial line.
    fn check_devices(&self, new: &Settings) -> Result<(), ApplyError> {
        let serial = || new.ports.iter().flatten().filter_map(|port| Some((&port.name, device(port)?)));
        for (nth, (other, name)) in serial().enumerate() {
            if let Some((one, _)) = serial().take(nth).find(|(_, before)| self.is_same_device(before, name)) {
                return Err(ApplyError::SameDevice { one: one.clone(), other: other.clone() });
            }
        }
        Ok(())
    }
}

/// The device name of a serial port.
fn device(port: &Port) -> Option<&str> {
    match &port.kind {
        PortKind::Serial(serial) => Some(&serial.device),
        _ => None,
    }
}

fn captures(port: &Port) -> bool {
    matches!(&port.kind, PortKind::TcpServer(server) if server.framing == StreamFraming::Capture)
}

pub(super) fn is_scanner(port: &Port) -> bool {
    matches!(port.kind, PortKind::Scanner)
}
