//! Opens a line, and reopens it with back-off when it is lost; reports its status.

use embassy_time::{Duration, Timer};

use super::Line;
use crate::gateway::{PortState, Status};
use crate::hal::{OpenError, SerialLine};
use crate::settings::SerialSettings;
use crate::stats::{Event, LastError};

/// First and longest pause before a line is reopened.
const REOPEN_FIRST: Duration = Duration::from_millis(250);
const REOPEN_LONGEST: Duration = Duration::from_secs(5);

/// Opens and reopens a line.
pub(crate) struct Opening<'s> {
    port_state: &'s PortState,
    settings: &'s SerialSettings,
    /// Speeds are being tried interactively, so each opening is not logged.
    quiet: bool,
    pause: Duration,
}

impl<'s> Opening<'s> {
    pub(crate) fn new(port_state: &'s PortState, settings: &'s SerialSettings, quiet: bool) -> Self {
        Self { port_state, settings, quiet, pause: REOPEN_FIRST }
    }

    /// Returns the line if `host` could open it; sets the port's status.
    pub(crate) fn opened<L: SerialLine>(
        &mut self,
        opened: Result<L, OpenError>,
        jitter: Duration,
    ) -> Option<Line<'s, L>> {
        let device = self.settings.device.as_str();
        match opened {
            Ok(io) => {
                if !self.quiet {
                    log_info!("{} is open", device);
                }
                self.port_state.set_status(Status::Open);
                self.port_state.stats.note(LastError::None);
                self.pause = REOPEN_FIRST;
                Some(Line::new(io, &self.settings.line, jitter, &self.port_state.stats))
            }
            Err(error) => {
                self.port_state.stats.note(LastError::Port);
                if self.port_state.set_status(Status::Failed(error)) {
                    log_warn!("{} cannot be opened: {}", device, error);
                }
                None
            }
        }
    }

    /// Reports that the line is lost.
    pub(crate) fn lost(&self) {
        log_warn!("{} is lost", self.settings.device.as_str());
        self.port_state.stats.count(Event::LineLost);
        self.port_state.set_status(Status::Lost);
    }

    /// The pause before the next attempt.
    pub(crate) fn pause(&mut self) -> Timer {
        let pause = Timer::after(self.pause);
        self.pause = (self.pause * 2).min(REOPEN_LONGEST);
        pause
    }
}
