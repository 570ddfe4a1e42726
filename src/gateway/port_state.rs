//! The shared state of the ports: status, counters, and the units behind each.

use core::cell::{Cell, RefCell};
use core::net::SocketAddr;
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

/// The shared state of one port.
pub struct PortState {
    /// From the router: requests for outside servers, or responses for the master of a serial line. Only the router sends, only
    /// the port receives.
    pub(crate) queue: Channel,
    /// Counts the requests of a serial master, and the port's restarts.
    generation: AtomicU16,
    /// The port's settings have changed.
    pub(crate) changed: Signal<CriticalSectionRawMutex, ()>,
    /// The port's counters.
    pub stats: Counters,
    /// The port's connections to outside servers.
    pub(crate) sockets: [Socket; SOCKETS_MAX],
    /// Requests waiting at a client-side port.
    waiting: AtomicU16,
    status: Mutex<CriticalSectionRawMutex, Cell<Status>>,
    /// The device that has connected.
    // Others have none; also below.
    #[cfg(feature = "dial-in")]
    device: Mutex<CriticalSectionRawMutex, Cell<Option<SocketAddr>>>,
}

/// The status of a port.
// `Off` is 0, so that the initial state is all zeros, which take no flash on a board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Status {
    /// Not configured, or just reconfigured.
    Off,
    /// Working.
    Open,
    /// Working, and connects when the next request arrives.
    Idle,
    /// Working, and waits until its device connects.
    Waiting,
    /// It was open and has been lost; it is being reopened.
    Lost,
    /// It cannot be opened; it is tried again.
    Failed(OpenError),
}

impl Status {
    /// Order of precedence: of several servers, the lowest is the port's status.
    pub(crate) const fn rank(self) -> u8 {
        match self {
            Self::Open => 0,
            Self::Idle => 1,
            Self::Off => 2,
            Self::Waiting | Self::Lost | Self::Failed(_) => 3,
        }
    }
}

impl PortState {
    /// The state of an unused port.
    pub const fn new() -> Self {
        Self {
            queue: Channel::new(),
            generation: AtomicU16::new(0),
            changed: Signal::new(),
            stats: Counters::new(),
            sockets: [const { Socket::new() }; SOCKETS_MAX],
            waiting: AtomicU16::new(0),
            status: Mutex::new(Cell::new(Status::Off)),
            #[cfg(feature = "dial-in")]
            device: Mutex::new(Cell::new(None)),
        }
    }

    /// The device that has connected to the port.
    pub(crate) fn device(&self) -> Option<SocketAddr> {
        #[cfg(feature = "dial-in")]
        return self.device.lock(Cell::get);
        #[cfg(not(feature = "dial-in"))]
        None
    }

    /// Sets which device has connected, or that the port waits for it.
    #[cfg(feature = "dial-in")]
    pub(crate) fn set_device(&self, device: Option<SocketAddr>) {
        self.device.lock(|cell| cell.set(device));
        self.set_status(if device.is_some() { Status::Open } else { Status::Waiting });
    }

    /// Requests waiting at a client-side port.
    pub fn waiting(&self) -> u16 {
        self.waiting.load(Ordering::Relaxed)
    }

    pub(crate) fn set_waiting(&self, requests: usize) {
        self.waiting.store(requests as u16, Ordering::Relaxed);
    }

    /// The port's status.
    pub fn status(&self) -> Status {
        self.status.lock(Cell::get)
    }

    /// Invalidates responses to earlier requests; returns the generation of the next request.
    pub(crate) fn renew(&self) -> u16 {
        let generation = self.generation.load(Ordering::Relaxed).wrapping_add(1);
        self.generation.store(generation, Ordering::Relaxed);
        generation
    }

    pub(crate) fn generation(&self) -> u16 {
        self.generation.load(Ordering::Relaxed)
    }

    /// Sets the status; returns whether it has changed.
    pub(crate) fn set_status(&self, status: Status) -> bool {
        self.replace_status(status) != status
    }

    /// Sets the status; returns the previous one.
    pub(crate) fn replace_status(&self, status: Status) -> Status {
        self.status.lock(|cell| cell.replace(status))
    }
}

/// The status of one of several servers behind a port.
pub(super) type ServerState = Mutex<CriticalSectionRawMutex, Cell<Status>>;

/// The shared state of all ports. Boards keep it in a static; it is all zeros at start.
pub struct Ports<const N: usize> {
    pub(super) states: [PortState; N],
    pub(super) units: Shared<AllUnits>,
    pub(super) servers: [ServerState; SERVERS_MAX],
}

impl<const N: usize> Ports<N> {
    /// All ports unused.
    pub const fn new() -> Self {
        let servers = [const { Mutex::new(Cell::new(Status::Off)) }; SERVERS_MAX];
        let units = Mutex::new(RefCell::new(AllUnits::new()));
        Self { states: [const { PortState::new() }; N], units, servers }
    }
}

/// A port's state, with access to its units.
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
    /// The state, for the lifetime of the gateway.
    pub(crate) fn state(&self) -> &'g PortState {
        self.state
    }

    /// Calls `f` with the units behind the port.
    pub fn units<R>(&self, f: impl FnOnce(&mut Units) -> R) -> R {
        self.units.lock(|units| f(&mut units.borrow_mut().of(self.id)))
    }

    /// Records that something other than the expected response of `unit` was received.
    pub(crate) fn disturbed(&self, unit: u8, event: Event) {
        self.stats.count(event);
        self.units(|units| units.error(unit, event));
    }

    /// Records that the response of `unit` was corrupt, by `error`.
    pub(crate) fn corrupt(&self, unit: u8, error: Event) {
        self.stats.count(Event::Corrupt);
        // Already counted by the line.
        if !matches!(error, Event::Parity | Event::Framing) {
            self.stats.count(error);
        }
        self.units(|units| units.corrupt(unit, error));
    }

    /// Records that `unit` responded `took` after the end of the request.
    pub(crate) fn answered(&self, unit: u8, took: Duration, exception: bool) {
        self.units(|units| units.answered(unit, took, exception));
        self.stats.count(Event::Response);
        if exception {
            self.stats.count(Event::Exception);
        }
    }

    /// Records that `unit` did not respond: see [`Units::timed_out`].
    pub(crate) fn timed_out(&self, unit: u8, down_after: u8) {
        self.stats.count(Event::Timeout);
        if self.units(|units| units.timed_out(unit, Instant::now(), down_after)) {
            self.stats.count(Event::Silent);
        }
    }

    /// Restarts the port after a change of its settings.
    pub(crate) fn restart(&self) {
        #[cfg(feature = "dial-in")]
        self.device.lock(|cell| cell.set(None));
        self.set_status(Status::Off);
        self.units(|units| units.clear());
        self.changed.signal(());
    }
}
