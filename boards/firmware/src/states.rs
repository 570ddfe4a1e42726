//! The states of the data points and of the EtherCAT SubDevice, and what that takes.

use mobgate::fieldbus::{EthercatState, FileBuffer};
use mobgate::gateway::Gateway;
use mobgate::scanner::ScannerState;

/// The data points.
pub static SCANNER: ScannerState = ScannerState::new();
/// The SubDevice.
pub static ETHERCAT: EthercatState = EthercatState::new();
/// New firmware from a MainDevice, and files for it.
pub static FILES: FileBuffer = FileBuffer::new();

/// Adds both to the gateway.
pub(crate) fn join(gateway: Gateway<'static>) -> Gateway<'static> {
    gateway.with_scanner(&SCANNER).with_ethercat(&ETHERCAT)
}
