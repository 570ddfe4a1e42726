//! The gateway's diagnosis history (10F3h), and emergencies where enabled.

use ethercat_subdevice::diagnosis::{History, Text};

use super::config_error::ConfigError;
use super::shared::EthercatState;
use super::texts::{BACK, CONTROLLER_LOST, EXCEPTION, NOT_KEPT, OTHER_MODULE, REFUSED, SILENT};
use crate::scanner::{DeviceId, DeviceStatus};

impl EthercatState {
    /// Calls `f` with the history.
    pub(super) fn history<R>(&self, f: impl FnOnce(&mut History) -> R) -> R {
        self.history.lock(|history| f(&mut history.borrow_mut()))
    }

    fn report(&self, text: &Text, parameters: &[u8]) {
        self.history(|history| history.report(text, parameters));
    }

    /// Reports the outcome of a request to the slave `id`, by its status before and now.
    pub fn asked(&self, id: DeviceId, before: Option<DeviceStatus>, now: Option<DeviceStatus>) {
        let (Some(before), Some(now)) = (before, now) else { return };
        match (before.alive, now.alive) {
            (None | Some(true), Some(false)) => self.report(&SILENT, &[id.0]),
            (Some(false), Some(true)) => self.report(&BACK, &[id.0]),
            _ => {}
        }
        // A repeated exception is reported once.
        if now.exceptions != before.exceptions && now.exception != before.exception {
            self.report(&EXCEPTION, &[id.0, now.exception]);
        }
    }

    pub(super) fn configuration_refused(&self, why: ConfigError) {
        match why {
            ConfigError::OtherModule { slave } => self.report(&OTHER_MODULE, &[slave]),
            _ => self.report(&REFUSED, &[]),
        }
    }

    pub(super) fn configuration_not_kept(&self) {
        self.report(&NOT_KEPT, &[]);
    }

    pub(super) fn controller_failed(&self) {
        self.report(&CONTROLLER_LOST, &[]);
    }
}
