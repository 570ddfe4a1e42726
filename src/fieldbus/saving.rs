//! What a MainDevice has had taken over, on its way into the settings and into a store.

use core::cell::Cell;

use super::keeping::Keep;
use super::line::Speed;
use super::shared::{EthercatState, State};
use crate::settings::Settings;

impl EthercatState {
    /// Waits until the settings are to be saved, as somebody who has a store; says how.
    pub(crate) async fn keep_wanted(&self) -> Keep {
        self.keeping.wanted().await
    }

    /// The settings have been saved, or not.
    pub(crate) fn kept(&self, well: bool) {
        self.keeping.done(well);
        if !well {
            self.configuration_not_kept();
        }
    }

    /// The slaves are those of after power-on.
    pub(crate) fn restore(&self) {
        self.configuration(|configuration| configuration.replace(&[]));
    }

    /// Whether a MainDevice has had a configuration taken over, and the settings do not say so yet.
    pub(crate) fn has_changed(&self) -> bool {
        self.state.lock(Cell::get).taken_over
    }

    /// Whether the settings say the slaves of the configuration.
    pub(crate) fn is_told(&self, settings: &Settings) -> bool {
        self.configuration(|configuration| settings.slaves == configuration.slaves())
    }

    /// Puts the configuration that was taken over into the settings; how their line is to be set, if it is not set so.
    pub(crate) fn tell(&self, settings: &mut Settings) -> Option<Speed> {
        let State { speed, .. } = self.state.lock(Cell::get);
        self.configuration(|configuration| {
            settings.slaves.clear();
            // As many as there can be.
            let _ = settings.slaves.extend_from_slice(configuration.slaves());
        });
        let line = settings.ethercat_speed().map(Speed::of);
        self.update(|state| {
            state.taken_over = false;
            state.line = if line.is_some() { speed } else { Speed::NONE };
        });
        line.filter(|line| *line != speed).map(|_| speed)
    }
}
