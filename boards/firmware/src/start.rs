//! The settings at start-up: read from the flash, or deleted if the button is held for 5 s.

use core::fmt;

use embassy_time::{Duration, Timer};
use mobgate::gateway::reconfigure::{self, Unchanged};
use mobgate::hal::{Store, StoreError};

use crate::gateway::gateway;
use crate::lights::Lights;

/// Half period of the fast blinking.
const BLINK: Duration = Duration::from_millis(100);
/// Hold time of the button for a factory reset: 5 s.
const HELD_BLINKS: u32 = 50;

/// Whether the button is held for 5 s from now: meanwhile all lights blink fast, and afterwards they are on.
pub async fn is_held(is_pressed: impl Fn() -> bool, lights: &mut impl Lights) -> bool {
    for nth in 0..HELD_BLINKS {
        if !is_pressed() {
            lights.all(false);
            return false;
        }
        lights.all(nth % 2 == 0);
        Timer::after(BLINK).await;
    }
    lights.all(true);
    true
}

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
    reconfigure::load(gateway(), store, &|_| Ok(())).await.map(drop).map_err(Problem::Unchanged)
}
