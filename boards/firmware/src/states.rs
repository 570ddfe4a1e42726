//! The states of the data points and of the EtherCAT SubDevice.

use embassy_time::Duration;
use ethercat_subdevice::indicators::Lamps;
use mobgate::fieldbus::EthercatState;
use mobgate::gateway::Gateway;
use mobgate::scanner::ScannerState;

/// The data points.
pub static SCANNER: ScannerState = ScannerState::new();
/// The SubDevice.
pub static ETHERCAT: EthercatState = EthercatState::new();

/// Adds both to the gateway.
pub(crate) fn join(gateway: Gateway<'static>) -> Gateway<'static> {
    gateway.with_scanner(&SCANNER).with_ethercat(&ETHERCAT)
}

/// Waits for `time`, showing RUN and ERR on `lamps`; returns whether there was anything to show.
pub async fn light_for(lamps: &mut impl Lamps, time: Duration) -> bool {
    ETHERCAT.light_for(lamps, time).await
}
