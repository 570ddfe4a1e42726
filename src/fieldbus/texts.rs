//! The messages of the diagnosis history (10F3h).

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use ethercat_subdevice::diagnosis::{History, Severity, Text};

/// The history, shared by the SubDevice and the port.
pub(super) type SharedHistory = Mutex<CriticalSectionRawMutex, RefCell<History>>;

pub(super) const SILENT: Text = Text {
    id: 1,
    severity: Severity::Error,
    // Communication.
    emergency: 0x8100,
    text: "Modbus slave %d does not answer",
};

pub(super) const BACK: Text =
    Text { id: 2, severity: Severity::Information, emergency: 0x0000, text: "Modbus slave %d answers again" };

pub(super) const EXCEPTION: Text = Text {
    id: 3,
    severity: Severity::Warning,
    emergency: 0x8100,
    text: "Modbus slave %d refuses a request by exception %d",
};

pub(super) const REFUSED: Text = Text {
    id: 4,
    severity: Severity::Error,
    // Data set.
    emergency: 0x6300,
    text: "The configuration is refused: object 2006h says why",
};

pub(super) const NOT_KEPT: Text = Text {
    id: 5,
    severity: Severity::Error,
    emergency: 0x6300,
    text: "The configuration could not be saved",
};

pub(super) const CONTROLLER_LOST: Text = Text {
    id: 6,
    severity: Severity::Error,
    // Device hardware.
    emergency: 0x5000,
    text: "The EtherCAT controller failed and was started anew",
};

pub(super) const OTHER_MODULE: Text = Text {
    id: 7,
    severity: Severity::Error,
    emergency: 0x6300,
    text: "Slot %d holds another module than is expected",
};

/// All texts, for the ESI file. Slaves count from 0, as in the names of their objects.
pub(super) const TEXTS: &[Text] =
    &[SILENT, BACK, EXCEPTION, REFUSED, NOT_KEPT, CONTROLLER_LOST, OTHER_MODULE];
