//! Users whom SSH has authenticated, on their way to the console.

use std::net::IpAddr;
use std::os::unix::net::UnixStream as System;

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use mobgate::settings::PortId;

/// Concurrent sessions.
pub const SESSIONS_MAX: usize = 8;

/// Sessions that wait for the console's tasks, which take them at once.
pub(super) static ENTRANTS: Channel<CriticalSectionRawMutex, Entrant, SESSIONS_MAX> = Channel::new();

/// The authenticated user and the peer's address.
#[derive(Debug, Clone)]
pub struct Who {
    pub(crate) user: String,
    pub(crate) peer: IpAddr,
    /// The port of the settings.
    pub(crate) port: PortId,
}

/// An authenticated user, on the way to the console.
#[derive(Debug)]
pub struct Entrant {
    /// The console's end.
    pub(crate) stream: System,
    pub(crate) who: Who,
    /// Whether keys are typed at a terminal, or lines are run.
    pub(crate) edits: bool,
}

/// Waits for the next session.
pub async fn next_entrant() -> Entrant {
    ENTRANTS.receive().await
}
