//! What the tasks share of the ports: how each one is doing, its counters, and the units behind it.

use core::cell::{Cell, RefCell};
use core::ops::Deref;
use core::sync::atomic::{AtomicU16, Ordering};

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant};

use super::shared::Shared;
use super::socket::Socket;
use super::unit_health::{AllUnits, Units};
use crate::frame::Channel;
use crate::hal::OpenError;
use crate::settings::{PortId, SERVERS_MAX, SOCKETS_MAX};
use crate::stats::{Counters, Event};

/// What the tasks share of one port.
pub struct PortState {
    /// What the router has for the port: requests for outside servers, or answers for the master on a serial line. Only the
    /// router sends, only the port receives.
    pub(crate) queue: Channel,
    /// Counts the requests of the master on a serial line, and the port's runs.
    generation: AtomicU16,
    /// The settings of the port have changed.
    pub(crate) changed: Signal<CriticalSectionRawMutex, ()>,
    /// The port's counters.
    pub stats: Counters,
    /// The port's connections to outside servers.
    pub(crate) sockets: [Socket; SOCKETS_MAX],
    /// Requests that wait at a client-side port.
    waiting: AtomicU16,
    status: Mutex<CriticalSectionRawMutex, Cell<Status>>,
}

/// How a port is doing.
// `Off` is the 0: then a port's place is all zeros at the start, which take no place in a board's flash.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Status {
    /// Nothing is set here, or the port has just been set.
    Off,
    /// It works.
    Open,
    /// It works, and connects when the next request comes.
    Idle,
    /// It was open and is lost; it is opened again.
    Lost,
    /// It cannot be opened; it is tried again.
    Failed(OpenError),
}

impl Status {
    /// The lowest of those of several servers is the port's.
    pub(crate) const fn rank(self) -> u8 {
        match self {
            Self::Open => 0,
            Self::Idle => 1,
            Self::Off => 2,
            Self::Lost | Self::Failed(_) => 3,
        }
    }
}

impl PortState {
    /// A place without a port.
    pub const fn new() -> Self {
        Self {
            queue: Channel::new(),
            generation: AtomicU16::new(0),
            changed: Signal::new(),
            stats: Counters::new(),
            sockets: [const { Socket::new() }; SOCKETS_MAX],
            waiting: AtomicU16::new(0),
            status: Mutex::new(Cell::new(Status::Off)),
        }
    }

    /// Requests that wait at a client-side port.
    pub fn waiting(&self) -> u16 {
        self.waiting.load(Ordering::Relaxed)
    }

    pub(crate) fn set_waiting(&self, requests: usize) {
        self.waiting.store(requests as u16, Ordering::Relaxed);
    }

    /// How the port is doing.
    pub fn status(&self) -> Status {
        self.status.lock(Cell::get)
    }

    /// Answers to requests from before this moment find nobody; the generation of the next request.
    pub(crate) fn renew(&self) -> u16 {
        let generation = self.generation.load(Ordering::Relaxed).wrapping_add(1);
        self.generation.store(generation, Ordering::Relaxed);
        generation
    }

    pub(crate) fn generation(&self) -> u16 {
        self.generation.load(Ordering::Relaxed)
    }

    /// Notes how the port is doing; says whether that is news.
    pub(crate) fn set_status(&self, status: Status) -> bool {
        self.replace_status(status) != status
    }

    /// Notes how the port is doing; gives what was noted before.
    pub(crate) fn replace_status(&self, status: Status) -> Status {
        self.status.lock(|cell| cell.replace(status))
    }
}

/// How one of several servers behind a port is doing.
pub(super) type ServerState = Mutex<CriticalSectionRawMutex, Cell<Status>>;

/// What the tasks share of all ports. Boards keep it in a static; it is all zeros at start.
pub struct Ports<const N: usize> {
    pub(super) states: [PortState; N],
    pub(super) units: Shared<AllUnits>,
    pub(super) servers: [ServerState; SERVERS_MAX],
}

impl<const N: usize> Ports<N> {
    /// Places without ports.
    pub const fn new() -> Self {
        let servers = [const { Mutex::new(Cell::new(Status::Off)) }; SERVERS_MAX];
        let units = Mutex::new(RefCell::new(AllUnits::new()));
        Self { states: [const { PortState::new() }; N], units, servers }
    }
}

impl<const N: usize> Default for Ports<N> {
    fn default() -> Self {
        Self::new()
    }
}

/// A port's place, and its units among those of all ports.
#[derive(Clone, Copy)]
pub struct PortAt<'g> {
    pub(super) state: &'g PortState,
    pub(super) units: &'g Shared<AllUnits>,
    pub(super) id: PortId,
}

impl Deref for PortAt<'_> {
    type Target = PortState;

    fn deref(&self) -> &PortState {
        self.state
    }
}

impl<'g> PortAt<'g> {
    /// The place for as long as the gateway is there.
    pub(crate) fn state(&self) -> &'g PortState {
        self.state
    }

    /// Calls `f` with the units behind the port.
    pub fn units<R>(&self, f: impl FnOnce(&mut Units) -> R) -> R {
        self.units.lock(|units| f(&mut units.borrow_mut().of(self.id)))
    }

    /// Something else than the response of `unit` came while that was awaited.
    pub(crate) fn disturbed(&self, unit: u8, event: Event) {
        self.stats.count(event);
        self.units(|units| units.error(unit, event));
    }

    /// The response of `unit` came damaged, by `error`.
    pub(crate) fn corrupt(&self, unit: u8, error: Event) {
        self.stats.count(Event::Corrupt);
        // Faulty characters have been counted by the line.
        if !matches!(error, Event::Parity | Event::Framing) {
            self.stats.count(error);
        }
        self.units(|units| units.corrupt(unit, error));
    }

    /// `unit` answered `took` after the request's end.
    pub(crate) fn answered(&self, unit: u8, took: Duration, exception: bool) {
        self.units(|units| units.answered(unit, took, exception));
        self.stats.count(Event::Response);
        if exception {
            self.stats.count(Event::Exception);
        }
    }

    /// `unit` gave no response: see [`Units::timed_out`].
    pub(crate) fn timed_out(&self, unit: u8, down_after: u8) {
        self.stats.count(Event::Timeout);
        if self.units(|units| units.timed_out(unit, Instant::now(), down_after)) {
            self.stats.count(Event::Silent);
        }
    }

    /// The port's settings are others: it begins anew.
    pub(crate) fn restart(&self) {
        self.set_status(Status::Off);
        self.units(|units| units.clear());
        self.changed.signal(());
    }
}

impl Default for PortState {
    fn default() -> Self {
        Self::new()
    }
}
