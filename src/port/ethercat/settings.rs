//! What a MainDevice changes in the settings: slaves, the line of the port, and that they are saved.

use embassy_time::{Duration, Timer};

use super::keeping::Keep;
use super::line::Speed;
use super::place::EthercatPlace;
use crate::config::{LineSettings, PortKind, SerialSettings, write_line, write_lines};
use crate::gateway::Gateway;
use crate::hal::{Store, StoreError};

/// Between two looks whether the settings have been saved.
const PAUSE: Duration = Duration::from_millis(10);

/// The settings that are being saved: they cannot be changed until this is dropped.
struct Saving<'s, 'g>(&'s Gateway<'g>);

impl<'s, 'g> Saving<'s, 'g> {
    fn begin(gateway: &'s Gateway<'g>) -> Self {
        gateway.set_saving(true);
        Self(gateway)
    }
}

impl Drop for Saving<'_, '_> {
    fn drop(&mut self) {
        self.0.set_saving(false);
    }
}

impl Gateway<'_> {
    /// Saves the settings into `store` whenever a MainDevice asks for that (1010h, 1011h), for ever; without a SubDevice it ends.
    /// A board with an EtherCAT controller runs it once.
    pub async fn keep_settings(&self, store: &mut impl Store) {
        let Some(ethercat) = self.ethercat() else { return };
        loop {
            let keep = ethercat.keep_wanted().await;
            self.adopt(ethercat).await;
            if keep == Keep::Restore {
                ethercat.restore();
                self.change_settings(|settings| settings.slaves.clear());
            }
            let saved = self.save_for_ethercat(store).await;
            match saved {
                Ok(()) => log_info!("the settings were saved for EtherCAT"),
                Err(error) => log_warn!("the settings could not be saved for EtherCAT: {error}"),
            }
            ethercat.kept(saved.is_ok());
        }
    }

    /// A copy of the settings would take much memory, so they stay as they are meanwhile.
    async fn save_for_ethercat(&self, store: &mut impl Store) -> Result<(), StoreError> {
        let _saving = Saving::begin(self);
        write_lines(|n, line| self.settings(|settings| write_line(settings, n, line)), store).await
    }

    /// Puts what a MainDevice has had taken over into the settings.
    pub(crate) async fn adopt(&self, ethercat: &EthercatPlace) {
        while self.is_saving() {
            Timer::after(PAUSE).await;
        }
        if ethercat.has_news()
            && let Some(speed) = self.change_settings(|settings| ethercat.tell(settings))
        {
            self.set_speed(speed);
        }
    }

    /// Sets the line of the EtherCAT port as the MainDevice wants it.
    fn set_speed(&self, speed: Speed) {
        let changed = self.change_settings(|settings| {
            let id = settings.ethercat_line()?;
            let port = settings.ports.get_mut(id.index())?.as_mut()?;
            let PortKind::Serial(SerialSettings { line, .. }) = &mut port.kind else { return None };
            let Speed { baud, parity, stop_bits } = speed;
            log_info!("EtherCAT sets {} to {speed}; it was {}", port.name, line.speed());
            *line = LineSettings { baud, parity, stop_bits, ..*line };
            Some(id)
        });
        if let Some(place) = changed.and_then(|id| self.ports().get(id.index())) {
            place.restart();
        }
    }
}
