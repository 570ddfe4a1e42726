//! The keywords of an EtherCAT port.

use core::fmt::{self, Display};

use crate::settings::OnLoss;

pub(crate) const ON_LOSS: &[(&str, OnLoss)] =
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
