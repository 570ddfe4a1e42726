//! The three lights and the button of a NUCLEO-144.
//!
//! * Green: blinks once a second while every task responds; stops when one does not.
//! * Blue (yellow on the H743ZI2): the network has an address.
//! * Red: a port is lost or failed to open.
//! * With EtherCAT, once a controller answers or a port is configured for one: green is the RUN light, red the ERR light
//!   (ETG.1300).
//! * All three blink fast: the user button is being held at start-up; all three on: the settings are being deleted.

use embassy_stm32::Peri;
use embassy_stm32::gpio::{AnyPin, Input, Level, Output, Speed};
use embassy_time::{Duration, Timer};
use mobgate::gateway::{Gateway, Status};

/// Half period of the fast blinking.
const BLINK: Duration = Duration::from_millis(100);
/// Hold time of the button for a factory reset: 5 s.
const HELD_BLINKS: u32 = 50;

/// The lights.
pub(crate) struct Lights {
    green: Output<'static>,
    blue: Output<'static>,
    red: Output<'static>,
}

impl Lights {
    /// The lights on these pins, off.
    pub(crate) fn new(
        green: Peri<'static, AnyPin>,
        blue: Peri<'static, AnyPin>,
        red: Peri<'static, AnyPin>,
    ) -> Self {
        let light = |pin| Output::new(pin, Level::Low, Speed::Low);
        Self { green: light(green), blue: light(blue), red: light(red) }
    }

    fn all(&mut self, on: bool) {
        for light in [&mut self.green, &mut self.blue, &mut self.red] {
            light.set_level(on.into());
        }
    }

    /// Waits for `time`, showing the EtherCAT state meanwhile; returns whether there was any to show.
    pub(crate) async fn show_ethercat(&mut self, time: Duration) -> bool {
        // Images without it are smaller, see Cargo.toml.
        #[cfg(feature = "ethercat")]
        return crate::states::light_for(self, time).await;
        #[cfg(not(feature = "ethercat"))] // As above.
        {
            Timer::after(time).await;
            false
        }
    }

    /// Shows the gateway's state; leaves green and red to EtherCAT if it has them.
    pub(crate) fn show(&mut self, gateway: &Gateway<'_>, has_address: bool, ethercat: bool) {
        self.blue.set_level(has_address.into());
        if !ethercat {
            let broken = |status| matches!(status, Status::Lost | Status::Failed(_));
            self.green.toggle();
            self.red.set_level(gateway.ports().iter().any(|port| broken(port.status())).into());
        }
    }

    /// Whether the button is held for 5 s from now, shown by the lights. Pressed, it connects the pin to 3.3 V.
    pub(crate) async fn button_is_held(&mut self, button: &Input<'static>) -> bool {
        for nth in 0..HELD_BLINKS {
            if button.is_low() {
                self.all(false);
                return false;
            }
            self.all(nth % 2 == 0);
            Timer::after(BLINK).await;
        }
        self.all(true);
        true
    }
}

// Images without it are smaller, see Cargo.toml.
#[cfg(feature = "ethercat")]
impl ethercat_subdevice::indicators::Lamps for Lights {
    fn shine(&mut self, run: bool, error: bool) {
        self.green.set_level(run.into());
        self.red.set_level(error.into());
    }
}
