//! The three lights of a NUCLEO-144.
//!
//! * Green: blinks once a second while every task responds; stops when one does not.
//! * Blue (yellow on the H743ZI2): the network has an address.
//! * Red: a port is lost or failed to open.
//! * With EtherCAT, once a controller responds or a port is configured for one: green is the RUN light, red the ERR light
//!   (ETG.1300).
//! * All three blink fast: the user button is being held at start-up; all three on: the settings are being deleted.

use embassy_stm32::Peri;
use embassy_stm32::gpio::{AnyPin, Level, Output, Speed};
use mobgate_firmware::lights;

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
}

impl lights::Lamps for Lights {
    fn shine(&mut self, run: bool, error: bool) {
        self.green.set_level(run.into());
        self.red.set_level(error.into());
    }
}

impl lights::Lights for Lights {
    fn all(&mut self, on: bool) {
        for light in [&mut self.green, &mut self.blue, &mut self.red] {
            light.set_level(on.into());
        }
    }

    fn show(&mut self, has_address: bool, is_lost: bool, ethercat: bool) {
        self.blue.set_level(has_address.into());
        if !ethercat {
            self.green.toggle();
            self.red.set_level(is_lost.into());
        }
    }
}
