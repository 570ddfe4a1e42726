//! The light of a Pico.
//!
//! * Changes twice a second while every task responds; stands still when one does not.
//! * Blinks fast: the button is being held at start-up; on: the settings are being deleted.

use embassy_rp::gpio::Output;
use mobgate_firmware::lights::{Lamps, Lights};

pub(crate) struct Light(pub(crate) Output<'static>);

/// One light is not enough for it.
impl Lamps for Light {
    fn shine(&mut self, _run: bool, _error: bool) {}
}

impl Lights for Light {
    fn all(&mut self, on: bool) {
        self.0.set_level(on.into());
    }

    fn show(&mut self, _has_address: bool, _is_lost: bool, _ethercat: bool) {
        self.0.toggle();
    }
}
