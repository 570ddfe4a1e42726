//! Publishers: what wakes their tasks.

pub(crate) mod state;

use super::Gateway;
use super::points::Reloaded;
// As what uses it.
#[cfg(feature = "mqtt")]
use self::state::PublisherState;
use crate::settings::{MQTT, Settings};

impl Gateway<'_> {
    /// The state of publisher number `nth`.
    // As what uses it.
    #[cfg(feature = "mqtt")]
    pub(crate) fn publisher(&self, nth: usize) -> Option<&PublisherState> {
        self.publishers.get(nth)
    }

    /// Notes that values of points may have changed.
    pub(crate) fn values_changed(&self) {
        if MQTT {
            self.publishers.iter().for_each(|state| state.values.signal(()));
        }
    }

    /// Restarts the publishers that new settings change; all of them if the points are others.
    pub(super) fn follow_publishers(&self, old: &Settings, new: &Settings, points: Reloaded) {
        for (nth, state) in self.publishers.iter().enumerate().filter(|_| MQTT) {
            if old.publishers.get(nth) != new.publishers.get(nth) || points != Reloaded::Nothing {
                state.changed.signal(());
            }
        }
    }
}
