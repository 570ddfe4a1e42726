//! What a MainDevice may do, and why not.

use core::fmt::Write;

use ethercat_subdevice::al_state::AlStatusCode;
use ethercat_subdevice::coe::abort::Abort;
use heapless::String;

use super::GatewayObjects;
use crate::fieldbus::config_error::ConfigError;
use crate::fieldbus::keeping::Keep;
use crate::fieldbus::objects::REASON_BYTES;

impl<F, N> GatewayObjects<'_, F, N> {
    /// Checks the configuration; records the reason if it is refused.
    pub(super) fn check_configuration(&mut self) -> Result<(), Abort> {
        let checked = self.shared.check().map(|_| ());
        if let Err(why) = checked {
            self.shared.configuration_refused(why);
        }
        self.note(checked)
    }

    /// Checks whether `keep` is possible, and `signature` is right.
    pub(super) fn check_keeping(&mut self, keep: Keep, signature: u64) -> Result<(), Abort> {
        if signature != u64::from(keep.signature()) {
            return Err(Abort::NotStored);
        }
        let checked = match keep {
            _ if !self.shared.keeping.has_store() => Err(ConfigError::NoStore),
            Keep::Save if !self.shared.is_running() => Err(ConfigError::NotInUse),
            Keep::Restore if self.shared.is_running() => return Err(Abort::State),
            Keep::Save | Keep::Restore => Ok(()),
        };
        self.note(checked)
    }

    /// Applies the modules as written, on the way to SafeOp.
    pub(super) fn take_modules_over(&mut self) -> Result<(), AlStatusCode> {
        self.refused = self.slots.as_mut().and_then(|slots| slots.take_over().err());
        let Some(error) = self.refused else { return Ok(()) };
        self.shared.configuration_refused(error);
        Err(error.al_status())
    }

    /// Records why something is refused.
    pub(super) fn note(&mut self, checked: Result<(), ConfigError>) -> Result<(), Abort> {
        self.refused = checked.err();
        match self.refused {
            None => Ok(()),
            Some(ConfigError::NoPort | ConfigError::NoLine) => Err(Abort::LocalControl),
            Some(ConfigError::NotInUse) => Err(Abort::State),
            Some(ConfigError::NoStore | ConfigError::NotSaved) => Err(Abort::NotStored),
            Some(_) => Err(Abort::Incompatible),
        }
    }

    /// The reason of the last refusal, as text (2006h).
    pub(super) fn reason(&self) -> String<{ REASON_BYTES as usize }> {
        let mut text = String::new();
        if let Some(error) = self.refused.or(self.shared.missing()) {
            // Every reason fits, as a test checks.
            let _ = write!(text, "{error}");
        }
        text
    }
}
