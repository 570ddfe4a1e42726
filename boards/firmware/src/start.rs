//! The settings at start-up: read from the flash, or deleted if the button is held.

use core::fmt;

use mobgate::gateway::reconfigure::{self, Unchanged};
use mobgate::hal::{Store, StoreError};

use crate::gateway::gateway;

/// Why the gateway runs without the saved settings.
pub(crate) enum Problem {
    /// The button was held.
    Forgotten,
    /// The saved settings cannot be deleted.
    Store(StoreError),
    /// They cannot be read, or are not valid for this firmware or board.
    Unchanged(Unchanged),
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Forgotten => f.write_str("forgotten, because the button was held"),
            Self::Store(error) => write!(f, "not forgotten: {error}"),
            Self::Unchanged(error) => write!(f, "not taken over: {error}"),
        }
    }
}

/// Applies the saved settings, or deletes them if `forget`. Even after an error the gateway runs, and the problem can be fixed at
/// the console.
pub(crate) async fn settings(store: &mut impl Store, forget: bool) -> Result<(), Problem> {
    if forget {
        // An empty text means no settings.
        store.commit().await.map_err(Problem::Store)?;
        return Err(Problem::Forgotten);
    }
    reconfigure::load(gateway(), store).await.map(drop).map_err(Problem::Unchanged)
}
