//! How the settings change as a whole: by a line, or by what a store has.
//!
//! There is one draft for all consoles, since settings are large. Whoever changes, saves or loads has it alone till then, and
//! the gateway takes over what has become of it only if all of it is good.

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::mutex::MutexGuard;
use heapless::String;
use thiserror::Error;

use super::saved::{self, ReadError};
use crate::gateway::{ApplyError, Gateway};
use crate::hal::{Store, StoreError};
use crate::language;
use crate::language::{LineError, LoadError, WORD_BYTES_MAX, Warning};
use crate::settings::Settings;

/// Why the settings stay as they were.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum Unchanged {
    /// The line is wrong.
    #[error(transparent)]
    Line(#[from] LineError),
    /// The store gives nothing.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A line in the store is wrong.
    #[error("saved settings: {0}")]
    Text(#[from] LoadError),
    /// The board has not what they ask for.
    #[error(transparent)]
    Apply(#[from] ApplyError),
    /// The board has not what a line in the store asks for.
    #[error("saved settings: {0}")]
    Refused(Refused),
}

/// The first line of a text that asks for what the board has not.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("line {line}, column {column}: \"{word}\": {error}")]
pub struct Refused {
    /// The line's number, from 1.
    pub line: u32,
    /// Where the word starts, in characters from 1.
    pub column: usize,
    /// The word that asks for it.
    pub word: String<WORD_BYTES_MAX>,
    /// What there is not.
    pub error: ApplyError,
}

impl Refused {
    fn new(number: u32, line: &str, settings: &Settings, error: ApplyError) -> Self {
        let (column, word) = language::find_word(line, error.word(settings));
        Self { line: number, column, word, error }
    }
}

/// The draft, with whatever is left in it.
pub async fn draft<'s>(gateway: &'s Gateway<'_>) -> MutexGuard<'s, CriticalSectionRawMutex, Settings> {
    gateway.draft.lock().await
}

/// Changes the settings as `line` says.
pub async fn change(gateway: &Gateway<'_>, line: &str) -> Result<Option<Warning>, Unchanged> {
    let mut draft = draft(gateway).await;
    gateway.settings(|settings| draft.clone_from(settings));
    let applied = language::apply(&mut draft, line)?;
    let differs = gateway.settings(|settings| *draft != *settings);
    gateway.apply(&draft)?;
    if differs {
        gateway.set_unsaved(true);
    }
    Ok(applied.warning)
}

/// Makes the settings the text in `store`, `whatever` somebody else may have written there.
pub async fn save(gateway: &Gateway<'_>, store: &mut impl Store, whatever: bool) -> Result<(), StoreError> {
    let mut draft = draft(gateway).await;
    gateway.settings(|settings| draft.clone_from(settings));
    // What is changed while they are written is not in there.
    let unsaved = gateway.set_unsaved(false);
    store.overwrite(whatever);
    let saved = saved::write_store(&draft, store).await;
    if saved.is_err() && unsaved {
        gateway.set_unsaved(true);
    }
    saved
}

/// Takes over the settings that the text in `store` says, if there is one; says how long it is.
pub async fn load(gateway: &Gateway<'_>, store: &mut impl Store) -> Result<usize, Unchanged> {
    let mut draft = draft(gateway).await;
    let bytes = read(gateway, store, &mut draft).await?;
    if bytes > 0 {
        take_over(gateway, store, &draft)?;
    }
    Ok(bytes)
}

/// Reads the settings that the text in `store` says into `draft`, which is of no use after an error; says how long the text is.
/// The board can have them.
pub async fn read(
    gateway: &Gateway<'_>,
    store: &mut impl Store,
    draft: &mut Settings,
) -> Result<usize, Unchanged> {
    let mut error = None;
    // Only what all lines say together counts. If the board has not that, once more for the line that asks for it.
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
        let bytes = saved::read_store(store, draft, &mut look).await?;
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

/// Takes over `settings`, which were read from `store`.
pub fn take_over(
    gateway: &Gateway<'_>,
    store: &mut impl Store,
    settings: &Settings,
) -> Result<(), ApplyError> {
    gateway.apply(settings)?;
    store.taken_over();
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
