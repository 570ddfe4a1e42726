//! Applies settings: restarts the ports that have changed, and leaves all others running.

use embassy_time::Instant;

use super::check::{ApplyError, is_scanner};
use super::points::{self, Reloaded};
use super::{Gateway, Status};
use crate::settings::{AUDIT, PORTS_MAX, PortId, SERVERS_MAX, Settings};

impl Gateway<'_> {
    /// Applies `new`. Rules and special units take effect with the next request; ports whose kind or settings differ are restarted,
    /// the others keep running.
    pub fn apply(&self, new: &Settings) -> Result<(), ApplyError> {
        self.check(new)?;
        self.put_in_force(new)
    }

    /// Applies settings that have been checked.
    pub(super) fn put_in_force(&self, new: &Settings) -> Result<(), ApplyError> {
        let mut points = Reloaded::Nothing;
        if let Some(port_state) = self.scanner() {
            let load = |scanner: &mut _| self.settings(|old| points::load(scanner, old, new, Instant::now()));
            points = port_state.change(load)?;
        }
        let mut changed = [false; PORTS_MAX];
        let other_slaves = self.settings(|settings| settings.slaves != new.slaves);
        self.change_settings(|settings| {
            for (index, changed) in changed.iter_mut().enumerate() {
                let id = PortId(index as u8);
                // The data points behind its pending requests may be gone.
                let reloaded = points == Reloaded::All && new.port(id).is_some_and(is_scanner);
                *changed = reloaded || settings.restarts(new, id);
            }
            self.move_server_statuses(settings, new);
            if settings.own_network() != new.own_network() {
                self.network_changed.signal(());
            }
            if settings.mdns != new.mdns || settings.network != new.network || settings.ports != new.ports {
                self.mdns_changed.signal(());
            }
            if AUDIT && settings.syslog != new.syslog {
                self.audit.iter().for_each(|audit| audit.server_changed.signal(()));
            }
            if AUDIT && settings.ntp != new.ntp {
                self.calendar.iter().for_each(|calendar| calendar.server_changed.signal(()));
            }
            self.follow_publishers(settings, new, points);
            settings.clone_from(new);
        });
        // Only the web interface is notified.
        #[cfg(feature = "web")]
        self.web.settings_changed();
        self.follow_ethercat(new, other_slaves);
        for port_state in
            self.port_states().filter(|port_state| changed.get(port_state.id.index()) == Some(&true))
        {
            let id = port_state.id;
            let old = self.connections.iter().filter(|connection| connection.state().port == Some(id));
            old.for_each(|connection| connection.assign(None));
            port_state.restart();
        }
        for (index, port) in new.ports.iter().enumerate() {
            if let (Some(port), Some(true)) = (port, changed.get(index)) {
                let free = self.connections.iter().filter(|connection| connection.state().port.is_none());
                free.take(port.kind.connections())
                    .for_each(|connection| connection.assign(Some(PortId(index as u8))));
            }
        }
        Ok(())
    }

    /// The status of a server is stored by its index in the settings: moves it when the indexes change.
    fn move_server_statuses(&self, old: &Settings, new: &Settings) {
        let mut statuses = [Status::Off; SERVERS_MAX];
        for (status, line) in statuses.iter_mut().zip(&new.servers) {
            let before = old.servers.iter().position(|before| before == line);
            *status =
                before.and_then(|port_state| self.server_status(port_state, None)).unwrap_or(Status::Off);
        }
        for (port_state, status) in statuses.into_iter().enumerate() {
            self.server_status(port_state, Some(status));
        }
    }
}
