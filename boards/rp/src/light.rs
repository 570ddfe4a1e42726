//! The light of a Pico, and the button for a factory reset.
//!
//! * Changes twice a second while every task responds; stands still when one does not.
//! * Blinks fast: the button is being held at start-up; on: the settings are being deleted.

use embassy_rp::gpio::{Input, Output};
use embassy_time::{Duration, Timer};
use mobgate_firmware::watchdog::Lights;

/// Half period of the fast blinking.
const BLINK: Duration = Duration::from_millis(100);
/// Hold time of the button for a factory reset: 5 s.
const HELD_BLINKS: u32 = 50;

/// The light.
pub(crate) struct Light(pub(crate) Output<'static>);

impl Light {
    /// Whether the button is held for 5 s from now, shown by the light. Pressed, it connects the pin to ground.
    pub(crate) async fn button_is_held(&mut self, button: &Input<'static>) -> bool {
        for nth in 0..HELD_BLINKS {
            if button.is_high() {
                self.0.set_low();
                return false;
            }
            self.0.set_level((nth % 2 == 0).into());
            Timer::after(BLINK).await;
        }
        self.0.set_high();
        true
    }
}

impl Lights for Light {
    async fn show_ethercat(&mut self, time: Duration) -> bool {
        Timer::after(time).await;
        false
    }

    fn show(&mut self, _has_address: bool, _is_lost: bool, _ethercat: bool) {
        self.0.toggle();
    }
}
