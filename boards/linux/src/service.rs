//! Reports to the service manager: ready, alive (watchdog), stopping (sd_notify(3)).
//!
//! Without one nothing is sent, and no timer runs.

use embassy_time::{Duration, Timer};
use sd_notify::{NotifyState, notify, watchdog_enabled};

/// Signs of life in the time after which the manager takes the program for hung.
const SIGNS: u64 = 3;

/// Says that the gateway runs, then gives signs of life if the manager waits for them (`WatchdogSec=`). A task of the executor, so that
/// they end when the executor stands still.
pub async fn run() {
    tell(NotifyState::Ready);
    let Some(limit) = watchdog_enabled() else { return };
    let interval = Duration::from_micros(limit.as_micros() as u64 / SIGNS);
    loop {
        Timer::after(interval).await;
        tell(NotifyState::Watchdog);
    }
}

/// Says that the gateway stops.
pub fn stops() {
    tell(NotifyState::Stopping);
}

fn tell(state: NotifyState<'_>) {
    if let Err(error) = notify(&[state]) {
        log::warn!("the service manager cannot be told: {error}");
    }
}
