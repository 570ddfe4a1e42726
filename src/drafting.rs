//! How the settings change as a whole: by a line, or by what a store has.
//!
//! There is one draft for all consoles, since settings are large. Whoever changes, saves or loads has it alone till then, and
//! the gateway takes over what has become of it only if all of it is good.

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::mutex::{Mutex, MutexGuard};
use thiserror::Error;

use crate::config::{self, LineError, LoadError, ReadError, Settings, Warning};
use crate::gateway::{ApplyError, Gateway};
use crate::hal::{Store, StoreError};

/// The draft.
pub(crate) type Draft = Mutex<CriticalSectionRawMutex, Settings>;

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
}

/// The draft, with whatever is left in it.
pub async fn draft<'s>(gateway: &'s Gateway<'_>) -> MutexGuard<'s, CriticalSectionRawMutex, Settings> {
    gateway.draft.lock().await
}

/// Changes the settings as `line` says.
pub async fn change(gateway: &Gateway<'_>, line: &str) -> Result<Option<Warning>, Unchanged> {
    let mut draft = draft(gateway).await;
    gateway.settings(|settings| draft.clone_from(settings));
    let applied = config::apply(&mut draft, line)?;
    gateway.apply(&draft)?;
    Ok(applied.warning)
}

/// Makes the settings the text in `store`.
pub async fn save(gateway: &Gateway<'_>, store: &mut impl Store) -> Result<(), StoreError> {
    let mut draft = draft(gateway).await;
    gateway.settings(|settings| draft.clone_from(settings));
    config::write_store(&draft, store).await
}

/// Takes over the settings that the text in `store` says, if there is one; says how long it is.
pub async fn load(gateway: &Gateway<'_>, store: &mut impl Store) -> Result<usize, Unchanged> {
    let mut draft = draft(gateway).await;
    let bytes = config::read_store(store, &mut draft).await.map_err(|error| match error {
        ReadError::Store(error) => Unchanged::Store(error),
        ReadError::Text(error) => Unchanged::Text(error),
    })?;
    if bytes > 0 {
        gateway.apply(&draft)?;
    }
    Ok(bytes)
}
