//! The settings at the start: read from the flash, or forgotten when the button is held.

use core::fmt;

use mobgate::gateway::reconfigure::{self, Unchanged};
use mobgate::hal::{Store, StoreError};

use crate::gateway::gateway;

/// Why the gateway runs without the saved settings.
pub(crate) enum Problem {
    /// The button was held.
    Forgotten,
    /// The flash cannot be made to forget them.
    Store(StoreError),
    /// The flash gives nothing, or what this firmware does not understand, or this board does not have.
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

/// Takes the saved settings over, or after `forget` forgets them. Whatever goes wrong, the gateway runs and the console is
/// there to set it right.
pub(crate) async fn settings(store: &mut impl Store, forget: bool) -> Result<(), Problem> {
    if forget {
        // An empty text is none.
        store.commit().await.map_err(Problem::Store)?;
        return Err(Problem::Forgotten);
    }
    reconfigure::load(gateway(), store).await.map(drop).map_err(Problem::Unchanged)
}
