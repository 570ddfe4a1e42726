//! Whether the board's controller answers.

use core::fmt;

use ethercat_subdevice::esc::EscError;

/// Whether the board's controller answers.
// `Present` is the 0: a place is all zeros at start. It is also what holds where nobody looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum Controller {
    /// It does.
    #[default]
    Present,
    /// It has not yet.
    Missing(EscError),
    /// It has, and does not any more.
    Lost(EscError),
}

impl Controller {
    /// What is wrong with it.
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
