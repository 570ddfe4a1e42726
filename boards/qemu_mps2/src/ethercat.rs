//! Data points, and EtherCAT once a LAN9252 responds, with its RUN and ERR lights on the board's two LEDs.

mod pipes;
mod spi;

use embassy_executor::Spawner;
use embassy_time::Duration;
use ethercat_subdevice::foe::NoFiles;
use ethercat_subdevice::indicators::Lamps;
use ethercat_subdevice::lan9252::{Lan9252, Wiring};
use mobgate::fieldbus::{EthercatState, serve};
use mobgate::gateway::Gateway;
use mobgate::scanner::ScannerState;

use self::spi::{Spi, Wires};
use crate::register::Register;

static SCANNER: ScannerState = ScannerState::new();
static ETHERCAT: EthercatState = EthercatState::new();

/// Adds both to the gateway.
pub(crate) const fn join(gateway: Gateway<'static>) -> Gateway<'static> {
    gateway.with_scanner(&SCANNER).with_ethercat(&ETHERCAT)
}

/// Starts the tasks, which wait for the controller.
pub(crate) fn start(spawner: Spawner) {
    // Spawned once: the task slots are free.
    spawner.spawn(run().unwrap());
    spawner.spawn(light().unwrap());
}

#[embassy_executor::task]
async fn run() {
    let wires = Wires::open();
    let controller = Lan9252::new(Spi(&wires), Wiring::default());
    // The pipes have no SYNC pins.
    serve(&ETHERCAT, Some(&SCANNER), NoFiles, controller, None, async || wires.interrupt().await).await
}

/// LED register of the FPGA's I/O (AN386): bit 0 is LED0, bit 1 is LED1.
const LEDS: Register = Register::at(0x4002_8000, 0);
/// Poll interval while there is nothing to show.
const LIGHTS_LOOK: Duration = Duration::from_millis(500);

/// LED0 is the RUN light, LED1 the ERR light.
struct Leds;

impl Lamps for Leds {
    fn shine(&mut self, run: bool, error: bool) {
        LEDS.write(u32::from(run) | u32::from(error) << 1);
    }
}

#[embassy_executor::task]
async fn light() {
    loop {
        ETHERCAT.light_for(&mut Leds, LIGHTS_LOOK).await;
    }
}
