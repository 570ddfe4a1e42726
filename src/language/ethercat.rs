//! The keywords of an EtherCAT port.

use super::listed::keywords;
use crate::settings::OnLoss;

keywords!(pub(crate) ON_LOSS: OnLoss { "hold": Hold, "clear": Clear, "stop": Stop });
