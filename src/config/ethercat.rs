//! The port that asks Modbus devices for an EtherCAT MainDevice: `ethercat on-loss clear`.

use core::fmt::{self, Display};

use super::port_keys::Key;
use super::print::option;
use super::problem::LineError;
use super::words::Words;

/// How the process image meets the Modbus devices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EthercatSettings {
    /// What becomes of outputs when the MainDevice sends none any more.
    pub on_loss: OnLoss,
}

/// What becomes of the devices' outputs when the MainDevice leaves Op, or its watchdog runs out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OnLoss {
    /// The last ones stay in force: a device that has others gets them again.
    Hold,
    /// All become 0.
    Clear,
    /// Nothing is written any more.
    #[default]
    Stop,
}

pub(super) const ETHERCAT_KEYS: &[(&str, Key)] = &[("on-loss", Key::OnLoss)];

pub(super) const ETHERCAT_EXPECTED: &str = "on-loss";

const ON_LOSS: &[(&str, OnLoss)] =
    &[("hold", OnLoss::Hold), ("clear", OnLoss::Clear), ("stop", OnLoss::Stop)];

/// Sets what `key` says.
pub(super) fn set_ethercat(
    settings: &mut EthercatSettings,
    key: Key,
    words: &mut Words,
) -> Result<(), LineError> {
    let value = words.take();
    match key {
        Key::OnLoss => settings.on_loss = value.keyword(ON_LOSS, "hold, clear or stop")?,
        _ => return Err(value.expected(ETHERCAT_EXPECTED)),
    }
    Ok(())
}

impl Display for EthercatSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ethercat")?;
        option(f, "on-loss", self.on_loss, self.on_loss != OnLoss::default())
    }
}

impl Display for OnLoss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Hold => "hold",
            Self::Clear => "clear",
            Self::Stop => "stop",
        })
    }
}
