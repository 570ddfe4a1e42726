//! The controllers that the suite runs on: by default one with direct access; the tests in `controllers` run all of them.

use crate::Lan9252;
use crate::lan9252::{Spi, Timing};
use crate::{Interrupt, Kind, SharedChip};
use embassy_time::Duration;
use ethercat_subdevice::lan9252::{InterruptPin, Lan9252 as Driver, Wiring};

/// The environment variable that selects the controller.
pub const CHOICE: &str = "MOBGATE_CONTROLLER";
/// Pause between two frames: with direct access, and over SPI.
pub(super) const PAUSE: Duration = Duration::from_micros(50);
pub(super) const SPI_PAUSE: Duration = Duration::from_millis(2);
/// A LAN9252 is ready 20 ms after its driver resets it.
pub(super) const POWER_ON: Duration = Duration::from_millis(50);

/// A controller, and the processor's access to it.
#[derive(Debug, Clone, Copy)]
pub struct Controller {
    /// Its name in [`CHOICE`].
    pub name: &'static str,
    pub(super) kind: Kind,
    /// A LAN9252 on SPI with this pin; otherwise direct access.
    pub(super) spi: Option<InterruptPin>,
    /// The processor latches rising edges of its line instead of sampling the level.
    pub(super) edges: bool,
}

/// All controllers; the first is the default.
pub const CONTROLLERS: [Controller; 7] = [
    Controller { name: "4-level", kind: Kind::LAN9252, spi: None, edges: false },
    Controller { name: "8-level", kind: Kind::ET1100, spi: None, edges: false },
    Controller { name: "8-edge", kind: Kind::ET1100, spi: None, edges: true },
    lan9252("spi-high-level", InterruptPin::High, false),
    lan9252("spi-low-edge", InterruptPin::Low, true),
    lan9252("spi-open-drain-level", InterruptPin::OpenDrain, false),
    lan9252("spi-open-drain-edge", InterruptPin::OpenDrain, true),
];

const fn lan9252(name: &'static str, pin: InterruptPin, edges: bool) -> Controller {
    Controller { name, kind: Kind::LAN9252, spi: Some(pin), edges }
}

/// The driver of a LAN9252 with this pin, the interrupt line as it is on a board, and the chip.
pub fn lan9252_with(
    chip: SharedChip,
    interrupt: InterruptPin,
    timing: Timing,
) -> (Driver<Spi>, Interrupt, Lan9252) {
    let lan9252 = Lan9252::new(chip, timing);
    let driver = Driver::new(lan9252.spi(), Wiring { interrupt, ..Wiring::default() });
    let (line, lan9252) = match interrupt {
        InterruptPin::High => (lan9252.interrupt(), lan9252),
        InterruptPin::Low | InterruptPin::OpenDrain => {
            let lan9252 = lan9252.pulled_up();
            (lan9252.interrupt().inverted(), lan9252)
        }
    };
    (driver, line, lan9252)
}

impl Controller {
    /// The controller selected by the environment variable [`CHOICE`].
    ///
    /// # Panics
    /// If no controller has that name.
    pub fn chosen() -> Self {
        let [usual, ..] = CONTROLLERS;
        let Ok(name) = std::env::var(CHOICE) else { return usual };
        let chosen = CONTROLLERS.into_iter().find(|controller| controller.name == name);
        chosen.unwrap_or_else(|| panic!("no controller is called {name}"))
    }
}
