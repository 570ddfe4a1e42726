//! Begins a candidate, puts it in force, and takes it back.

use core::convert::Infallible;
use core::future::pending;

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::mutex::{MutexGuard, TryLockError};
use embassy_time::{Duration, Instant, with_deadline};
use thiserror::Error;

use super::audit::{Actor, Way};
use super::candidate::{Candidate, Stage};
use super::cut_off::{CutOff, cut_off};
use super::reconfigure::Unchanged;
use super::{ApplyError, Gateway, reconfigure, saved};
use crate::hal::{Store, StoreError};
use crate::settings::Settings;

/// Why a candidate could not be begun, changed or committed.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub(crate) enum Uncommitted {
    #[error("there is no candidate: `candidate` begins one")]
    Nothing,
    #[error("there is a candidate already: `commit` puts it in force, `discard` drops it")]
    Open,
    #[error("{}", reconfigure::UNCONFIRMED)]
    Waiting,
    #[error("no commit waits for its confirmation")]
    NotWaiting,
    #[error("the settings in force have changed: see `diff`, then `commit` again")]
    Changed,
    #[error("somebody commits at this moment")]
    Busy,
    #[error(transparent)]
    Apply(#[from] ApplyError),
    #[error("nothing has changed: {0}")]
    Store(#[from] StoreError),
    #[error("this would cut you off: {0}; `commit confirmed 5m` can be taken back")]
    CutOff(CutOff),
    #[error("there is no such version: see `versions`")]
    NoVersion,
    #[error(transparent)]
    Version(#[from] Unchanged),
}

impl From<TryLockError> for Uncommitted {
    fn from(_: TryLockError) -> Self {
        Self::Busy
    }
}

/// A saved version, as a store to read from.
struct Version<'s, S> {
    store: &'s mut S,
    nth: usize,
}

impl<S: Store> Store for Version<'_, S> {
    async fn read(&mut self, offset: usize, into: &mut [u8]) -> Result<usize, StoreError> {
        self.store.read_version(self.nth, offset, into).await
    }

    async fn append(&mut self, _: &[u8]) -> Result<(), StoreError> {
        Err(StoreError::Failed)
    }

    async fn commit(&mut self) -> Result<(), StoreError> {
        Err(StoreError::Failed)
    }
}

impl Candidate {
    /// The candidate's settings.
    pub(crate) fn settings(&self) -> Result<MutexGuard<'_, CriticalSectionRawMutex, Settings>, Uncommitted> {
        if !self.is_open() {
            return Err(Uncommitted::Nothing);
        }
        Ok(self.settings.try_lock()?)
    }

    /// Begins a candidate with the settings in force.
    pub(crate) fn begin(&self, gateway: &Gateway<'_>) -> Result<(), Uncommitted> {
        match self.stage() {
            Stage::Nothing => {}
            Stage::Open { .. } => return Err(Uncommitted::Open),
            Stage::Waiting { .. } => return Err(Uncommitted::Waiting),
        }
        let mut settings = self.settings.try_lock()?;
        gateway.settings(|in_force| settings.clone_from(in_force));
        self.set(Stage::Open { changes: gateway.changes() });
        Ok(())
    }

    /// Makes the `nth` of the versions in `store` the candidate, whatever the candidate was.
    pub(crate) async fn bring_back(
        &self,
        gateway: &Gateway<'_>,
        store: &mut impl Store,
        nth: usize,
    ) -> Result<(), Uncommitted> {
        let mut settings = self.settings.try_lock()?;
        if self.is_waiting() {
            return Err(Uncommitted::Waiting);
        }
        // A version that cannot be read must leave the candidate unchanged.
        let mut draft = reconfigure::draft(gateway).await;
        if reconfigure::read(gateway, &mut Version { store, nth }, &mut draft).await? == 0 {
            return Err(Uncommitted::NoVersion);
        }
        settings.clone_from(&draft);
        self.set(Stage::Open { changes: gateway.changes() });
        Ok(())
    }

    /// Drops the candidate.
    pub(crate) fn discard(&self) -> Result<(), Uncommitted> {
        drop(self.settings()?);
        self.set(Stage::Nothing);
        Ok(())
    }

    /// Puts the candidate in force: saves it, or waits for its confirmation for `confirmed`. Confirms a commit that waits. After an
    /// error the settings in force are those of before. What would cut off `actor`, who has come by `way`, must be `confirmed`.
    pub(crate) async fn commit(
        &self,
        gateway: &Gateway<'_>,
        store: &mut impl Store,
        confirmed: Option<Duration>,
        (actor, way): (Actor<'_>, Way),
    ) -> Result<(), Uncommitted> {
        let mut settings = self.settings.try_lock()?;
        gateway.sign(store, actor);
        let changes = match (self.stage(), confirmed) {
            (Stage::Nothing, _) => return Err(Uncommitted::Nothing),
            (Stage::Waiting { unsaved, .. }, Some(time)) => {
                self.set(Stage::Waiting { until: Instant::now() + time, unsaved });
                return Ok(());
            }
            (Stage::Waiting { .. }, None) => {
                reconfigure::write(gateway, store, false).await?;
                self.set(Stage::Nothing);
                return Ok(());
            }
            (Stage::Open { changes }, _) => changes,
        };
        if changes != gateway.changes() {
            self.set(Stage::Open { changes: gateway.changes() });
            return Err(Uncommitted::Changed);
        }
        let mut before = reconfigure::draft(gateway).await;
        gateway.settings(|in_force| before.clone_from(in_force));
        gateway.check(&settings)?;
        let why = gateway.settings(|in_force| cut_off(in_force, &settings, actor, way));
        if let Some(why) = why.filter(|_| confirmed.is_none()) {
            return Err(Uncommitted::CutOff(why));
        }
        gateway.audit_difference(actor, &settings);
        gateway.put_in_force(&settings)?;
        let unsaved = gateway.set_unsaved(true);
        if let Some(time) = confirmed {
            settings.clone_from(&before);
            self.set(Stage::Waiting { until: Instant::now() + time, unsaved });
            return Ok(());
        }
        store.overwrite(false);
        match saved::write_store(&settings, store, &mut *gateway.stored_line.lock().await).await {
            Ok(()) => {
                gateway.set_unsaved(false);
                self.set(Stage::Nothing);
                Ok(())
            }
            Err(error) => {
                gateway.audit_difference(actor, &before);
                self.go_back(gateway, &before, unsaved);
                self.set(Stage::Open { changes: gateway.changes() });
                Err(error.into())
            }
        }
    }

    /// Reverts a commit that waits for its confirmation.
    pub(crate) async fn roll_back(&self, gateway: &Gateway<'_>, actor: Actor<'_>) -> Result<(), Uncommitted> {
        let settings = self.settings.lock().await;
        let Stage::Waiting { unsaved, .. } = self.stage() else { return Err(Uncommitted::NotWaiting) };
        gateway.audit_difference(actor, &settings);
        // Nobody changes settings meanwhile.
        let _draft = reconfigure::draft(gateway).await;
        self.go_back(gateway, &settings, unsaved);
        self.set(Stage::Nothing);
        Ok(())
    }

    fn go_back(&self, gateway: &Gateway<'_>, before: &Settings, unsaved: bool) {
        match gateway.put_in_force(before) {
            Ok(()) => _ = gateway.set_unsaved(unsaved),
            // They were in force before, so the board can run them.
            Err(error) => log_warn!("the settings from before cannot be applied: {error}"),
        }
    }
}

impl Gateway<'_> {
    /// Reverts commits that are not confirmed in time, forever. A board with a candidate runs it once.
    pub async fn watch_commits(&self) -> Infallible {
        loop {
            let Some(candidate) = self.candidate() else { pending().await };
            let changed = candidate.changed.wait();
            let is_over = match candidate.stage() {
                Stage::Waiting { until, .. } => with_deadline(until, changed).await.is_err(),
                Stage::Nothing | Stage::Open { .. } => {
                    changed.await;
                    false
                }
            };
            if is_over && candidate.roll_back(self, Actor::Gateway).await.is_ok() {
                log_warn!("nobody has confirmed the commit: the settings from before are back in force");
            }
        }
    }
}
