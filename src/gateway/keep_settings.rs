//! Settings changed by a MainDevice: slaves and the port's line; and saving on its request.

use super::audit::{Actor, Topic};
use super::{Gateway, reconfigure};
use crate::fieldbus::{EthercatState, Keep, Speed};
use crate::hal::Store;
use crate::settings::{LineSettings, PortKind, SerialSettings};

impl Gateway<'_> {
    /// Saves the settings to `store` whenever a MainDevice requests it (1010h, 1011h), forever; returns if there is no SubDevice. A
    /// board with an EtherCAT controller runs it once.
    pub async fn keep_settings(&self, store: &mut impl Store) {
        let Some(ethercat) = self.ethercat() else { return };
        loop {
            let keep = ethercat.keep_wanted().await;
            self.adopt(ethercat);
            if keep == Keep::Restore {
                ethercat.restore();
                self.change_settings(|settings| settings.slaves.clear());
            }
            self.sign(store, Actor::Ethercat);
            let saved = reconfigure::save(self, store, true).await;
            match saved {
                Ok(()) => self.audit(Topic::Save, Actor::Ethercat, format_args!("save")),
                Err(error) => log_warn!("the settings could not be saved for EtherCAT: {error}"),
            }
            ethercat.kept(saved.is_ok());
        }
    }

    /// Copies the configuration applied by a MainDevice into the settings.
    pub(crate) fn adopt(&self, ethercat: &EthercatState) {
        if !ethercat.has_changed() {
            return;
        }
        // A MainDevice that sends the same configuration at each start changes nothing.
        if !self.settings(|settings| ethercat.is_told(settings)) {
            self.set_unsaved(true);
            self.audit(Topic::Settings, Actor::Ethercat, format_args!("another configuration of slaves"));
        }
        if let Some(speed) = self.change_settings(|settings| ethercat.tell(settings)) {
            self.set_speed(speed);
        }
    }

    /// Sets the line of the EtherCAT port as requested by the MainDevice.
    fn set_speed(&self, speed: Speed) {
        let changed = self.change_settings(|settings| {
            let id = settings.ethercat_line()?;
            let port = settings.ports.get_mut(id.index())?.as_mut()?;
            let PortKind::Serial(SerialSettings { line, .. }) = &mut port.kind else { return None };
            let Speed { baud, parity, stop_bits } = speed;
            let before = line.speed();
            *line = LineSettings { baud, parity, stop_bits, ..*line };
            self.set_unsaved(true);
            Some((id, before))
        });
        let Some((id, before)) = changed else { return };
        self.settings(|settings| {
            let what = format_args!("{} is set to {speed}; it was {before}", settings.name(id));
            self.audit(Topic::Settings, Actor::Ethercat, what);
        });
        if let Some(port_state) = self.port_state(id) {
            port_state.restart();
        }
    }
}
