//! What the gateway tells by its diagnosis history (10F3h), and by emergencies where they are wanted.

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use ethercat_subdevice::diagnosis::{History, Severity, Text};

use super::configuration::ConfigError;
use super::place::EthercatPlace;
use crate::scanner::{DeviceId, DeviceStatus};

/// The history, which the SubDevice and the port share.
pub(super) type SharedHistory = Mutex<CriticalSectionRawMutex, RefCell<History>>;

const SILENT: Text = Text {
    id: 1,
    severity: Severity::Error,
    // Communication.
    emergency: 0x8100,
    text: "Modbus slave %d does not answer",
};
const BACK: Text =
    Text { id: 2, severity: Severity::Information, emergency: 0x0000, text: "Modbus slave %d answers again" };
const EXCEPTION: Text = Text {
    id: 3,
    severity: Severity::Warning,
    emergency: 0x8100,
    text: "Modbus slave %d refuses a request by exception %d",
};
const REFUSED: Text = Text {
    id: 4,
    severity: Severity::Error,
    // Data set.
    emergency: 0x6300,
    text: "The configuration is refused: object 2006h says why",
};
const NOT_KEPT: Text = Text {
    id: 5,
    severity: Severity::Error,
    emergency: 0x6300,
    text: "The configuration could not be saved",
};
const CONTROLLER_LOST: Text = Text {
    id: 6,
    severity: Severity::Error,
    // Device hardware.
    emergency: 0x5000,
    text: "The EtherCAT controller failed and was started anew",
};

const OTHER_MODULE: Text = Text {
    id: 7,
    severity: Severity::Error,
    emergency: 0x6300,
    text: "Slot %d holds another module than is expected",
};

/// All of them, for the ESI file. Slaves count from 0, as in the names of their objects.
pub(super) const TEXTS: &[Text] =
    &[SILENT, BACK, EXCEPTION, REFUSED, NOT_KEPT, CONTROLLER_LOST, OTHER_MODULE];

impl EthercatPlace {
    /// Calls `f` with the history.
    pub(super) fn history<R>(&self, f: impl FnOnce(&mut History) -> R) -> R {
        self.history.lock(|history| f(&mut history.borrow_mut()))
    }

    fn report(&self, text: &Text, parameters: &[u8]) {
        self.history(|history| history.report(text, parameters));
    }

    /// The slave `id` was asked: how it was before, and how it is now.
    pub fn asked(&self, id: DeviceId, before: Option<DeviceStatus>, now: Option<DeviceStatus>) {
        let (Some(before), Some(now)) = (before, now) else { return };
        match (before.alive, now.alive) {
            (None | Some(true), Some(false)) => self.report(&SILENT, &[id.0]),
            (Some(false), Some(true)) => self.report(&BACK, &[id.0]),
            _ => {}
        }
        // The same one again and again is told once.
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
