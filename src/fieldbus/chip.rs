//! Presence of the board's controller.

use core::fmt;

use ethercat_subdevice::esc::EscError;

/// Presence of the board's controller.
// `Present` is 0, so that a static is all zeros at start. It also applies where nothing checks the controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum Controller {
    /// It responds.
    #[default]
    Present,
    /// It has not responded yet.
    Missing(EscError),
    /// It has stopped responding.
    Lost(EscError),
}

impl Controller {
    /// What is wrong with the controller.
    pub fn fault(self) -> Option<EscError> {
        match self {
            Self::Present => None,
            Self::Missing(fault) | Self::Lost(fault) => Some(fault),
        }
    }
}

impl fmt::Display for Controller {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Present => "EtherCAT controller present",
            Self::Missing(_) => "EtherCAT controller missing",
            Self::Lost(_) => "EtherCAT controller lost",
        })
    }
}
