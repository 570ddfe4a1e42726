//! The gateway's RUN and ERR indicators: at the console, and on a board's LEDs.

use core::cell::Cell;

use embassy_futures::select::select;
use embassy_time::{Duration, Timer};
use ethercat_subdevice::indicators::{Indicators, Lamps, Pattern, show};

use super::chip::Controller;
use super::shared::{EthercatState, State};

impl EthercatState {
    /// Records what the SubDevice indicates.
    pub(super) fn set_indicators(&self, indicators: Indicators) {
        let Indicators { state: shown, fault, fell } = indicators;
        self.update(|state| (state.shown, state.fault, state.fell) = (Some(shown), fault, fell));
    }

    fn shown(&self) -> Option<Indicators> {
        let State { shown, fault, fell, .. } = self.state.lock(Cell::get);
        shown.map(|state| Indicators { state, fault, fell })
    }

    /// What the SubDevice indicates, if it has started and its controller responds.
    pub fn indicators(&self) -> Option<Indicators> {
        self.shown().filter(|_| self.controller() == Controller::Present)
    }

    /// The patterns of the RUN light and of the ERR light: without a controller, RUN is off and ERR is on.
    pub fn lights(&self) -> (Pattern, Pattern) {
        match (self.controller(), self.shown()) {
            (Controller::Present, Some(indicators)) => (indicators.run(), indicators.error()),
            (Controller::Present, None) => (Pattern::Off, Pattern::Off),
            (Controller::Missing(_) | Controller::Lost(_), _) => (Pattern::Off, Pattern::On),
        }
    }

    /// Shows the patterns on a board's LEDs, forever.
    pub async fn light(&self, lamps: &mut impl Lamps) -> ! {
        show(lamps, || self.lights()).await
    }

    /// Shows the patterns for `time` on LEDs that also serve other purposes, if a controller responds or a port waits for one.
    /// Returns whether it did.
    pub async fn light_for(&self, lamps: &mut impl Lamps, time: Duration) -> bool {
        let end = Timer::after(time);
        if !self.state.lock(Cell::get).has_port && self.indicators().is_none() {
            end.await;
            return false;
        }
        select(self.light(lamps), end).await;
        true
    }
}
