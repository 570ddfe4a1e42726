//! Data points, and EtherCAT as soon as a LAN9252 answers.

mod pipes;
mod spi;

use embassy_executor::Spawner;
use ethercat_subdevice::lan9252::{Lan9252, Wiring};
use mobgate::gateway::Gateway;
use mobgate::port::ethercat::{EthercatPlace, serve};
use mobgate::scanner::ScannerPlace;

use self::spi::{Spi, Wires};

static SCANNER: ScannerPlace = ScannerPlace::new();
static PLACE: EthercatPlace = EthercatPlace::new();

/// The gateway with both.
pub(crate) const fn join(gateway: Gateway<'static>) -> Gateway<'static> {
    gateway.with_scanner(&SCANNER).with_ethercat(&PLACE)
}

/// Starts looking for the controller.
pub(crate) fn start(spawner: Spawner) {
    // Spawned once: its place is free.
    spawner.spawn(run().unwrap());
}

#[embassy_executor::task]
async fn run() {
    let wires = Wires::open();
    let controller = Lan9252::new(Spi(&wires), Wiring::default());
    serve(&PLACE, Some(&SCANNER), controller, async || wires.interrupt().await).await
}
