//! The messages of the diagnosis history (10F3h).

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use ethercat_subdevice::diagnosis::{History, Severity, Text};

/// The history, shared by the SubDevice and the port.
pub(super) type SharedHistory = Mutex<CriticalSectionRawMutex, RefCell<History>>;

// Error codes of emergency messages.
const NONE: u16 = 0x0000;
const DEVICE_HARDWARE: u16 = 0x5000;
const DATA_SET: u16 = 0x6300;
const COMMUNICATION: u16 = 0x8100;

const fn text(id: u16, severity: Severity, emergency: u16, text: &'static str) -> Text {
    Text { id, severity, emergency, text }
}

pub(super) const SILENT: Text = text(1, Severity::Error, COMMUNICATION, "Modbus slave %d does not respond");
pub(super) const BACK: Text = text(2, Severity::Information, NONE, "Modbus slave %d responds again");
pub(super) const EXCEPTION: Text =
    text(3, Severity::Warning, COMMUNICATION, "Modbus slave %d refuses a request by exception %d");
pub(super) const REFUSED: Text =
    text(4, Severity::Error, DATA_SET, "The configuration is refused: object 2006h says why");
pub(super) const NOT_KEPT: Text = text(5, Severity::Error, DATA_SET, "The configuration could not be saved");
pub(super) const CONTROLLER_LOST: Text =
    text(6, Severity::Error, DEVICE_HARDWARE, "The EtherCAT controller failed and was started anew");
pub(super) const OTHER_MODULE: Text =
    text(7, Severity::Error, DATA_SET, "Slot %d holds another module than is expected");

/// All texts, for the ESI file. Slaves count from 0, as in the names of their objects.
pub(super) const TEXTS: &[Text] =
    &[SILENT, BACK, EXCEPTION, REFUSED, NOT_KEPT, CONTROLLER_LOST, OTHER_MODULE];
