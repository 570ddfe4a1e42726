//! Transfers a configuration applied by a MainDevice to the settings and to a store.

use core::cell::Cell;

use super::keeping::Keep;
use super::line::Speed;
use super::shared::{EthercatState, State};
use crate::settings::Settings;

impl EthercatState {
    /// Waits for a request to save the settings. To be called by the owner of a store.
    pub(crate) async fn keep_wanted(&self) -> Keep {
        self.keeping.wanted().await
    }

    /// Reports whether the settings were saved.
    pub(crate) fn kept(&self, well: bool) {
        self.keeping.done(well);
        if !well {
            self.configuration_not_kept();
        }
    }

    /// Restores the default slaves.
    pub(crate) fn restore(&self) {
        self.configuration(|configuration| configuration.replace(&[]));
    }

    /// Whether a MainDevice has applied a configuration that the settings do not contain yet.
    pub(crate) fn has_changed(&self) -> bool {
        self.state.lock(Cell::get).taken_over
    }

    /// Whether the settings contain the configured slaves.
    pub(crate) fn is_told(&self, settings: &Settings) -> bool {
        self.configuration(|configuration| settings.slaves == configuration.slaves())
    }

    /// Copies the applied configuration to the settings; returns the required line settings if they differ.
    pub(crate) fn tell(&self, settings: &mut Settings) -> Option<Speed> {
        let State { speed, .. } = self.state.lock(Cell::get);
        self.configuration(|configuration| {
            settings.slaves.clear();
            // The same capacity.
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
