//! The time of day from an NTP server, for boards without a clock of their own.

pub(super) mod state;

use core::fmt;
use core::future::pending;

use embassy_time::Instant;

use self::state::TimeState;
use super::Gateway;
use super::audit::{Actor, Stamp};
use super::date::Date;
use crate::hal::{OpenError, Store};
use crate::settings::ServerAddress;

impl Gateway<'_> {
    /// What is known of the time.
    fn time_state<R>(&self, f: impl FnOnce(&mut TimeState) -> R) -> Option<R> {
        Some(self.calendar.first()?.state.lock(|state| f(&mut state.borrow_mut())))
    }

    /// The date of `at`, once an NTP server has responded.
    pub fn date(&self, at: Instant) -> Option<Date> {
        self.time_state(|state| state.date(at))?
    }

    /// The date of `at`, or the time itself.
    pub(super) fn stamp(&self, at: Instant) -> Stamp {
        self.date(at).map_or(Stamp::Up(at), Stamp::Date)
    }

    /// Signs the next version in `store`.
    pub(crate) fn sign(&self, store: &mut impl Store, actor: Actor<'_>) {
        store.sign(&actor, || self.date(Instant::now()).map(|Date(us)| us));
    }

    /// Sets the clock: according to `server` it was `date` at the time `at`. Returns why it was refused.
    pub fn set_time(&self, server: &ServerAddress, told: Result<(Date, Instant), OpenError>) {
        let was_unknown = self.time_state(|state| {
            let was_unknown = state.start.is_none();
            state.fault = told.err();
            if let Ok((Date(us), at)) = told {
                state.start = Some(Date(us.saturating_sub(at.as_micros())));
                state.source = Some(server.clone());
            }
            was_unknown && state.start.is_some()
        });
        if was_unknown == Some(true) {
            log_info!("the time is known from {server}");
            self.date_audit();
        }
    }

    /// Writes the date of `now` and its source; nothing without an NTP server.
    pub(crate) fn write_time(
        &self,
        asked: Option<&ServerAddress>,
        now: Instant,
        out: &mut dyn fmt::Write,
    ) -> fmt::Result {
        let Some(TimeState { start, source, fault }) = self.time_state(|state| state.clone()) else {
            return Ok(());
        };
        if let (Some(start), Some(source)) = (start, source) {
            let date = Date(start.0.saturating_add(now.as_micros()));
            write!(out, ", {date} by {source}")?;
        }
        match (asked, fault) {
            (Some(asked), Some(fault)) => write!(out, ", no time from {asked}: {fault}"),
            (Some(asked), None) if start.is_none() => write!(out, ", {asked} is asked for the time"),
            _ => Ok(()),
        }
    }

    /// Waits until the settings name another NTP server, or none; one task may wait.
    pub async fn new_ntp(&self) {
        match self.calendar.first() {
            Some(calendar) => calendar.server_changed.wait().await,
            None => pending().await,
        }
    }
}
