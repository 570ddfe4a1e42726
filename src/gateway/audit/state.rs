//! The state of the audit trail.

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;

use super::trail::Trail;
use crate::gateway::port_state::Status;
use crate::gateway::shared::Shared;

/// The trail without its lines, and the task notified of new ones.
pub(in crate::gateway) struct Audit {
    pub(super) trail: Shared<Trail>,
    /// A line for the syslog server.
    pub(super) line: Signal<CriticalSectionRawMutex, ()>,
    /// A refusal was counted.
    pub(super) refusal: Signal<CriticalSectionRawMutex, ()>,
    pub(in crate::gateway) server_changed: Signal<CriticalSectionRawMutex, ()>,
    pub(super) forwarding: Shared<Forwarding>,
}

/// The state of forwarding to a syslog server.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Forwarding {
    /// The number of the last line that was sent.
    pub sent: u32,
    /// Lines that never reached the server: overwritten before they were sent, or known to be lost.
    pub lost: u32,
    /// The connection to the server.
    pub status: Status,
}

impl Forwarding {
    pub(super) const NONE: Self = Self { sent: 0, lost: 0, status: Status::Off };
}

impl Audit {
    pub(in crate::gateway) const fn new() -> Self {
        Self {
            trail: Mutex::new(RefCell::new(Trail::new())),
            line: Signal::new(),
            refusal: Signal::new(),
            server_changed: Signal::new(),
            forwarding: Mutex::new(RefCell::new(Forwarding::NONE)),
        }
    }
}
