//! Changes of the settings: by a line, or by loading them from a store.
//!
//! Settings are large, so all consoles share one draft. A change, save or load locks it exclusively, and the gateway applies it
//! only if all of it is valid.

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::mutex::MutexGuard;
use heapless::String;
use thiserror::Error;

#[cfg(feature = "files")]
use super::audit::Actor;
use super::saved::{self, ReadError};
use crate::gateway::cut_off::CutOff;
use crate::gateway::{ApplyError, Candidate, Gateway};
use crate::hal::{Store, StoreError};
use crate::language;
use crate::language::{LineError, LoadError, WORD_BYTES_MAX, Warning};
use crate::settings::{PasswordHash, Settings};

/// Why the settings did not change.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum Unchanged {
    /// The line is invalid.
    #[error(transparent)]
    Line(#[from] LineError),
    /// The store cannot be read or written.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A line in the store is invalid.
    #[error("saved settings: {0}")]
    Text(#[from] LoadError),
    /// The board lacks what the settings need.
    #[error(transparent)]
    Apply(#[from] ApplyError),
    /// The board lacks what a line in the store needs.
    #[error("saved settings: {0}")]
    Refused(Refused),
    /// Who wants the change would be cut off by it.
    #[error(
        "this would cut you off: {0}; `candidate`, the change, then `commit confirmed 5m` can be taken back"
    )]
    CutOff(CutOff),
}

impl From<CutOff> for Unchanged {
    fn from(why: CutOff) -> Self {
        Self::CutOff(why)
    }
}

/// A last look at settings that are about to be in force, or why they must not be.
pub(crate) type Ahead<'a> = &'a dyn Fn(&Settings) -> Result<(), CutOff>;

/// The first line of a text that needs something the board lacks.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("line {line}, column {column}: \"{word}\": {error}")]
pub struct Refused {
    /// The line's number, from 1.
    pub line: u32,
    /// Where the word starts, in characters from 1.
    pub column: usize,
    /// The word that needs it.
    pub word: String<WORD_BYTES_MAX>,
    /// What the board lacks.
    pub error: ApplyError,
}

impl Refused {
    /// After each line of a text, which comes once: what the board lacks for `settings`, those so far, if it lacks anything, and
    /// the first line from which on it did.
    #[cfg(feature = "files")] // As what uses it; also below.
    pub(crate) fn follow(
        lacks: &mut Option<Self>,
        gateway: &Gateway<'_>,
        (number, line): (u32, &str),
        settings: &Settings,
    ) {
        match gateway.check(settings) {
            Ok(()) => *lacks = None,
            Err(error) if lacks.as_ref().is_some_and(|lacks| lacks.error == error) => {}
            Err(error) => *lacks = Some(Self::new(number, line, settings, error)),
        }
    }

    fn new(number: u32, line: &str, settings: &Settings, error: ApplyError) -> Self {
        let (column, word) = language::find_word(line, error.word(settings));
        Self { line: number, column, word, error }
    }
}

/// Why settings are not saved that may yet be taken back.
pub(crate) const UNCONFIRMED: &str =
    "a commit waits for its confirmation: `commit` confirms it, `rollback` takes it back";

/// Locks the draft, whatever its content.
pub fn draft<'s>(
    gateway: &'s Gateway<'_>,
) -> impl Future<Output = MutexGuard<'s, CriticalSectionRawMutex, Settings>> {
    gateway.draft.lock()
}

/// Changes the settings by `line`: those of the candidate, if there is one; else after a last look by `ahead` if they are others.
pub async fn change(
    gateway: &Gateway<'_>,
    line: &str,
    ahead: Ahead<'_>,
) -> Result<Option<Warning>, Unchanged> {
    if let Some(candidate) = gateway.candidate().filter(|candidate| candidate.is_open()) {
        let mut settings = candidate.lock().ok_or(StoreError::Refused("somebody commits at this moment"))?;
        return Ok(language::apply(&mut settings, line)?.warning);
    }
    let applied = change_by(gateway, |draft| language::apply(draft, line), ahead).await?;
    Ok(applied.warning)
}

/// Applies what `change` makes of the settings, unless it fails, after a last look by `ahead` if they are others.
async fn change_by<R>(
    gateway: &Gateway<'_>,
    change: impl FnOnce(&mut Settings) -> Result<R, LineError>,
    ahead: Ahead<'_>,
) -> Result<R, Unchanged> {
    let mut draft = draft(gateway).await;
    gateway.settings(|settings| draft.clone_from(settings));
    let changed = change(&mut draft)?;
    let differs = gateway.settings(|settings| *draft != *settings);
    gateway.check(&draft)?;
    if differs {
        ahead(&draft)?;
    }
    gateway.put_in_force(&draft)?;
    if differs {
        gateway.set_unsaved(true);
    }
    Ok(changed)
}

/// Sets the password of `user`, who may be gone by now.
// Without users nothing calls it.
#[cfg_attr(not(feature = "users"), allow(dead_code))]
pub(crate) async fn set_password(
    gateway: &Gateway<'_>,
    user: &str,
    hash: PasswordHash,
) -> Result<(), Unchanged> {
    let set = |draft: &mut Settings| {
        if let Some(user) = draft.user_mut(user) {
            user.password = Some(hash);
        }
        Ok(())
    };
    change_by(gateway, set, &|_| Ok(())).await
}

/// Writes the settings to `store`; `whatever`: even if the text there was changed by others.
pub async fn save(gateway: &Gateway<'_>, store: &mut impl Store, whatever: bool) -> Result<(), StoreError> {
    // A reset must take back what nobody has confirmed.
    if gateway.candidate().is_some_and(Candidate::is_waiting) {
        return Err(StoreError::Refused(UNCONFIRMED));
    }
    write(gateway, store, whatever).await
}

/// [`save`], also of settings that wait for their confirmation.
pub(super) async fn write(
    gateway: &Gateway<'_>,
    store: &mut impl Store,
    whatever: bool,
) -> Result<(), StoreError> {
    let mut draft = draft(gateway).await;
    gateway.settings(|settings| draft.clone_from(settings));
    // Changes during the write are not saved.
    let unsaved = gateway.set_unsaved(false);
    store.overwrite(whatever);
    let saved = saved::write_store(&draft, store, &mut *gateway.stored_line.lock().await).await;
    if saved.is_err() && unsaved {
        gateway.set_unsaved(true);
    }
    saved
}

/// Loads the settings in `store`, if any, and applies them, after a last look by `ahead`; returns the length of the text.
pub async fn load(
    gateway: &Gateway<'_>,
    store: &mut impl Store,
    ahead: Ahead<'_>,
) -> Result<usize, Unchanged> {
    let mut draft = draft(gateway).await;
    let bytes = read(gateway, store, &mut draft).await?;
    if bytes > 0 {
        ahead(&draft)?;
        take_over(gateway, store, &draft)?;
    }
    Ok(bytes)
}

/// Reads the settings in `store` into `draft`, which is invalid after an error, and checks that the board can run them; returns
/// the length of the text.
pub async fn read(
    gateway: &Gateway<'_>,
    store: &mut impl Store,
    draft: &mut Settings,
) -> Result<usize, Unchanged> {
    let mut error = None;
    // Only the complete settings can be checked. If the board lacks something, the text is read again to find the line.
    loop {
        let mut refused = None;
        let mut look = |number, line: &str, settings: &Settings| {
            if error.is_some()
                && refused.is_none()
                && let Err(error) = gateway.check(settings)
            {
                refused = Some(Refused::new(number, line, settings, error));
            }
        };
        let line = &mut *gateway.stored_line.lock().await;
        let bytes = saved::read_store(store, draft, line, &mut look).await?;
        if let Some(refused) = refused {
            return Err(Unchanged::Refused(refused));
        }
        match gateway.check(draft) {
            Ok(()) => return Ok(bytes),
            Err(again) if error.is_some() => return Err(Unchanged::Apply(again)),
            Err(first) => error = Some(first),
        }
    }
}

/// Applies `settings` read from `store`.
pub fn take_over(
    gateway: &Gateway<'_>,
    store: &mut impl Store,
    settings: &Settings,
) -> Result<(), ApplyError> {
    gateway.apply(settings)?;
    store.taken_over();
    gateway.set_unsaved(false);
    gateway.candidate().into_iter().for_each(Candidate::settle);
    Ok(())
}

/// Saves `settings`, and puts them in force, for `actor`; neither if either fails.
#[cfg(feature = "files")]
pub(crate) async fn commit(
    gateway: &Gateway<'_>,
    store: &mut impl Store,
    settings: &mut Settings,
    actor: Actor<'_>,
) -> Result<(), Unchanged> {
    if gateway.candidate().is_some_and(Candidate::is_waiting) {
        return Err(StoreError::Refused(UNCONFIRMED).into());
    }
    gateway.check(settings)?;
    gateway.sign(store, actor);
    store.overwrite(false);
    // First, as there is no memory for settings to go back to.
    saved::write_store(settings, store, &mut *gateway.stored_line.lock().await).await?;
    let applied = gateway.check(settings).and_then(|()| {
        gateway.audit_difference(actor, settings);
        gateway.put_in_force(settings)
    });
    if let Err(error) = applied {
        gateway.settings(|in_force| settings.clone_from(in_force));
        saved::write_store(settings, store, &mut *gateway.stored_line.lock().await).await?;
        return Err(error.into());
    }
    gateway.set_unsaved(false);
    Ok(())
}

impl From<ReadError> for Unchanged {
    fn from(error: ReadError) -> Self {
        match error {
            ReadError::Store(error) => Self::Store(error),
            ReadError::Text(error) => Self::Text(error),
        }
    }
}
