//! The settings at the start: read from the flash, or forgotten when the button is held.

use core::fmt;

use mobgate::config::{LoadError, ReadError, Settings, read_store};
use mobgate::gateway::ApplyError;
use mobgate::hal::{Store, StoreError};

use crate::gateway::gateway;

/// Why the gateway runs without the saved settings.
pub enum Problem {
    /// The button was held.
    Forgotten,
    /// The flash gives nothing.
    Store(StoreError),
    /// A line that this firmware does not understand.
    Text(LoadError),
    /// Something that this board does not have.
    Apply(ApplyError),
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Forgotten => f.write_str("forgotten, because the button was held"),
            Self::Store(error) => write!(f, "not read: {error}"),
            Self::Text(error) => write!(f, "not read: {error}"),
            Self::Apply(error) => write!(f, "not taken over: {error}"),
        }
    }
}

/// Takes the saved settings over, or after `forget` forgets them. Whatever goes wrong, the gateway runs and the console is
/// there to set it right.
pub(crate) async fn settings(store: &mut impl Store, forget: bool) -> Result<(), Problem> {
    if forget {
        // An empty text is none.
        store.commit().await.map_err(Problem::Store)?;
        return Err(Problem::Forgotten);
    }
    let mut settings = Settings::new();
    read_store(store, &mut settings).await.map_err(|error| match error {
        ReadError::Store(error) => Problem::Store(error),
        ReadError::Text(error) => Problem::Text(error),
    })?;
    gateway().apply(&settings).map_err(Problem::Apply)
}
