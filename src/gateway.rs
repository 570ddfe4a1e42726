//! The gateway: the state that all tasks share.
//!
//! A board keeps the frame pool, the port states and the connections in statics, builds a [`Gateway`] over them, and runs
//! [`Gateway::route`] once, [`Gateway::run_port`] for every port and [`Gateway::run_connection`] for every TCP connection it can
//! hold. [`Gateway::apply`] puts new settings in force and restarts what has changed.

use core::cell::RefCell;
use core::sync::atomic::Ordering::Relaxed;
use core::sync::atomic::{AtomicBool, AtomicU32};

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;

use crate::capture::{CAPTURE, Capture};
use crate::fieldbus::EthercatState;
use crate::frame::{Channel, Envelope, Frame, FramePool, FrameWriter, Origin, ReplyTo, Stage};
use crate::modbus::Exception;
use crate::scanner::{POINTS, ScannerState};
use crate::settings::{AUDIT, OwnNetwork, PUBLISHERS_MAX, PortId, Settings};
use crate::stats::Log;

mod apply;
#[doc(hidden)] // Public for boards and tests.
pub mod audit;
mod calendar;
// Replaced by a stub in images without a candidate.
#[cfg_attr(not(feature = "candidate"), path = "gateway/no_candidate.rs")]
mod candidate;
mod check;
mod client_role;
// Without a candidate nothing is committed.
#[cfg(feature = "candidate")]
pub(crate) mod commit;
mod connection;
// As the candidate.
#[cfg_attr(not(feature = "candidate"), path = "gateway/no_cut_off.rs")]
pub(crate) mod cut_off;
// Images without a calendar have no dates.
#[cfg_attr(not(feature = "audit"), path = "gateway/no_date.rs")]
pub mod date;
// Without a candidate and an audit trail nobody asks.
#[cfg_attr(not(feature = "audit"), allow(dead_code))]
pub(crate) mod difference;
pub(crate) mod direct_request;
pub(crate) mod enter;
mod ethercat;
pub(crate) mod events;
mod export;
// As `web`.
#[cfg(feature = "web")]
pub(crate) mod hour;
mod keep_settings;
// Without users nothing calls it.
#[cfg_attr(not(feature = "users"), allow(dead_code))]
pub(crate) mod log_in;
#[doc(hidden)] // Public for tests/ only.
pub mod outstanding;
mod points;
mod port_state;
pub(crate) mod publishers;
pub mod reconfigure;
#[doc(hidden)] // Public for tests/ only.
pub mod response_times;
pub mod saved;
mod shared;
pub(crate) mod socket;
// Replaced where few have a line.
#[cfg_attr(not(feature = "web"), path = "gateway/no_stored_line.rs")]
mod stored_line;
mod take_firmware;
pub(crate) mod turns;
#[doc(hidden)] // Public for tests/ only.
pub mod unit_health;
// Most images have none.
#[cfg(feature = "web")]
pub(crate) mod web;

use self::audit::AuditMemory;
use self::audit::state::Audit;
use self::calendar::state::Calendar;
pub use self::candidate::Candidate;
pub use self::check::ApplyError;
pub use self::connection::{Connection, ConnectionState};
use self::direct_request::DirectRequestState;
pub use self::enter::Credential;
use self::events::Events;
use self::log_in::Attempts;
use self::port_state::ServerState;
pub use self::port_state::{PortAt, PortState, Ports, Status};
use self::publishers::state::{PublisherState, PublisherStates};
use self::shared::{Draft, Shared};
use self::socket::Socket;
use self::stored_line::StoredLine;
use self::turns::Turns;
use self::unit_health::AllUnits;
#[cfg(feature = "web")]
use self::web::Web;

/// The state that all tasks share.
pub struct Gateway<'g> {
    pool: &'g FramePool<'g>,
    ports: &'g [PortState],
    units: &'g Shared<AllUnits>,
    servers: &'g [ServerState],
    connections: &'g [Connection],
    /// The global queue: every port sends, only the router receives.
    pub(crate) inbox: Channel,
    settings: Shared<Settings>,
    /// Settings being changed, loaded or saved.
    pub(crate) draft: Draft,
    /// The line that is being loaded or saved. It is long, so all consoles share it.
    stored_line: StoredLine,
    /// Whether the settings in force differ from those last loaded or saved.
    unsaved: AtomicBool,
    /// How often the settings in force have changed.
    changes: AtomicU32,
    candidate: Option<&'g Candidate>,
    /// Whether two device names mean the same serial line.
    same_device: fn(&str, &str) -> bool,
    /// Whether the settings include the board's own address.
    owns_network: bool,
    network_changed: Signal<CriticalSectionRawMutex, ()>,
    mdns_changed: Signal<CriticalSectionRawMutex, ()>,
    log: Log,
    /// Turns shared by connections whose requests are refused.
    pub(crate) turns: Turns,
    /// A console's direct requests, which bypass the rules.
    pub(crate) direct_request: DirectRequestState,
    /// Event counter and log of the own unit.
    events: Shared<Events>,
    /// Failed attempts to log in.
    attempts: Shared<Attempts>,
    /// The audit trail, its lines, and the time for them.
    audit: [Audit; AUDIT as usize],
    audit_memory: Option<&'g AuditMemory>,
    calendar: [Calendar; AUDIT as usize],
    publishers: PublisherStates,
    // As its module.
    #[cfg(feature = "web")]
    pub(crate) web: Web,
    scanner: Option<&'g ScannerState>,
    capture: Option<&'g Capture>,
    ethercat: Option<&'g EthercatState>,
    /// Whether the settings name the network interface of the EtherCAT controller.
    ethercat_interfaces: bool,
    ethercat_changed: Signal<CriticalSectionRawMutex, ()>,
}

impl<'g> Gateway<'g> {
    /// A gateway without settings over a board's frames, port states and connections. The pool reserves one frame for each
    /// connection, then one for each port.
    pub const fn new<const N: usize>(
        pool: &'g FramePool<'g>,
        ports: &'g Ports<N>,
        connections: &'g [Connection],
    ) -> Self {
        Self {
            pool,
            ports: &ports.states,
            units: &ports.units,
            servers: &ports.servers,
            connections,
            inbox: Channel::new(),
            settings: Mutex::new(RefCell::new(Settings::new())),
            draft: Draft::new(Settings::new()),
            stored_line: StoredLine::new(),
            unsaved: AtomicBool::new(false),
            changes: AtomicU32::new(0),
            candidate: None,
            same_device: |one, other| one == other,
            owns_network: false,
            network_changed: Signal::new(),
            mdns_changed: Signal::new(),
            log: Log::new(),
            turns: Turns::new(),
            direct_request: DirectRequestState::new(),
            events: Mutex::new(RefCell::new(Events::new())),
            attempts: Mutex::new(RefCell::new(Attempts::new())),
            audit: [const { Audit::new() }; AUDIT as usize],
            audit_memory: None,
            calendar: [const { Calendar::new() }; AUDIT as usize],
            publishers: [const { PublisherState::new() }; PUBLISHERS_MAX],
            #[cfg(feature = "web")]
            web: Web::new(),
            scanner: None,
            capture: None,
            ethercat: None,
            ethercat_interfaces: false,
            ethercat_changed: Signal::new(),
        }
    }

    /// For boards whose serial lines have several names each: `same_device` tells whether two are the same line.
    #[must_use]
    pub const fn with_same_device(mut self, same_device: fn(&str, &str) -> bool) -> Self {
        self.same_device = same_device;
        self
    }

    /// Adds a candidate, which takes memory of its own.
    #[must_use]
    pub const fn with_candidate(mut self, candidate: &'g Candidate) -> Self {
        self.candidate = Some(candidate);
        self
    }

    /// The candidate, if the board has memory for it.
    pub(crate) fn candidate(&self) -> Option<&'g Candidate> {
        self.candidate.filter(|_| cfg!(feature = "candidate"))
    }

    /// Adds data points, which take memory of their own.
    #[must_use]
    pub const fn with_scanner(mut self, scanner: &'g ScannerState) -> Self {
        self.scanner = Some(scanner);
        self
    }

    /// Adds a capture ring, which takes memory of its own.
    #[must_use]
    pub const fn with_capture(mut self, capture: &'g Capture) -> Self {
        self.capture = Some(capture);
        self
    }

    /// The capture ring, if the board has memory for it.
    pub fn capture(&self) -> Option<&'g Capture> {
        if CAPTURE { self.capture } else { None }
    }

    /// The data points, if the board has memory for them. Row N is point N of the settings, and devices likewise.
    pub fn scanner(&self) -> Option<&'g ScannerState> {
        if POINTS { self.scanner } else { None }
    }

    /// For boards whose Ethernet belongs to the gateway: the settings include its address, and the board follows
    /// [`new_network`](Self::new_network). Elsewhere such settings are refused.
    pub const fn with_own_network(mut self) -> Self {
        self.owns_network = true;
        self
    }

    /// Waits until the settings change how the board gets its address; one task may wait.
    pub async fn new_network(&self) -> OwnNetwork {
        self.network_changed.wait().await;
        self.settings(Settings::own_network)
    }

    /// Waits until multicast DNS may have something new to announce: another name or other servers; one task may wait.
    pub fn new_mdns(&self) -> impl Future<Output = ()> {
        self.mdns_changed.wait()
    }

    /// The frames.
    pub fn pool(&self) -> &'g FramePool<'g> {
        self.pool
    }

    /// The port states; a port's id is its index.
    pub fn ports(&self) -> &'g [PortState] {
        self.ports
    }

    /// The state of port `id`, if it exists on the board.
    pub fn port_state(&self, id: PortId) -> Option<PortAt<'g>> {
        Some(PortAt { state: self.ports.get(id.index())?, units: self.units, id })
    }

    /// All port states, with the units of each.
    #[doc(hidden)] // Public for tests/ only.
    pub fn port_states(&self) -> impl Iterator<Item = PortAt<'g>> {
        (0..self.ports.len()).filter_map(|index| self.port_state(PortId(index as u8)))
    }

    /// The status of server number `server` in the settings; replaced by `new` if given, and the previous one returned.
    pub(crate) fn server_status(&self, server: usize, new: Option<Status>) -> Option<Status> {
        let status = self.servers.get(server)?;
        Some(status.lock(|status| new.map_or_else(|| status.get(), |new| status.replace(new))))
    }

    /// Handles the end of a port's connection: wakes the port that waits for its socket.
    pub(crate) fn socket_closed(&self, socket: &Socket) {
        let waits = |(id, link): (PortId, u8)| self.ports.get(id.index())?.sockets.get(usize::from(link));
        if let Some(socket) = socket.closed().and_then(waits) {
            socket.freed.signal(());
        }
    }

    /// The slots for TCP connections.
    pub fn connections(&self) -> &'g [Connection] {
        self.connections
    }

    /// The last transactions.
    pub fn log(&self) -> &Log {
        &self.log
    }

    /// Calls `f` with the event counter and log of the own unit.
    pub(crate) fn events<R>(&self, f: impl FnOnce(&mut Events) -> R) -> R {
        self.events.lock(|events| f(&mut events.borrow_mut()))
    }

    /// Calls `f` with the failed attempts to log in.
    pub(crate) fn attempts<R>(&self, f: impl FnOnce(&mut Attempts) -> R) -> R {
        self.attempts.lock(|attempts| f(&mut attempts.borrow_mut()))
    }

    /// Calls `f` with the settings in force.
    pub fn settings<R>(&self, f: impl FnOnce(&Settings) -> R) -> R {
        self.settings.lock(|settings| f(&settings.borrow()))
    }

    /// Whether the settings have changed since they were loaded or saved.
    pub fn has_unsaved(&self) -> bool {
        self.unsaved.load(Relaxed)
    }

    /// Sets whether they have; returns the previous value.
    pub(crate) fn set_unsaved(&self, unsaved: bool) -> bool {
        let before = self.has_unsaved();
        self.unsaved.store(unsaved, Relaxed);
        before
    }

    /// How often the settings in force have changed.
    pub(crate) fn changes(&self) -> u32 {
        self.changes.load(Relaxed)
    }

    /// Changes the settings in force. A caller that changes more than what is looked up per request must notify the ports.
    pub(crate) fn change_settings<R>(&self, f: impl FnOnce(&mut Settings) -> R) -> R {
        if self.candidate().is_some() || cfg!(feature = "files") {
            self.changes.store(self.changes().wrapping_add(1), Relaxed);
        }
        self.settings.lock(|settings| f(&mut settings.borrow_mut()))
    }

    /// A frame for something received by port `id`; its connections use their own reservations.
    pub(crate) fn take_for_port(&self, id: PortId) -> Option<(FrameWriter<'g>, Frame<'g>)> {
        // The pool's first frames are reserved for the connections, the next ones for the ports.
        self.pool.take(self.connections.len() + id.index())
    }

    /// The same, filled with a complete PDU.
    pub(crate) fn fill_for_port(&self, id: PortId, pdu: &[u8], envelope: Envelope) -> Option<Frame<'g>> {
        self.pool.fill(self.connections.len() + id.index(), pdu, envelope)
    }

    /// Whether the requester at `origin` is gone.
    pub(crate) fn is_gone(&self, origin: Origin) -> bool {
        match origin.reply_to {
            ReplyTo::Connection(connection) => {
                let is_gone = |connection: &mut ConnectionState| {
                    connection.generation != origin.generation || connection.peer.is_none()
                };
                self.connections
                    .get(usize::from(connection))
                    .is_none_or(|connection| connection.update(is_gone))
            }
            ReplyTo::Line | ReplyTo::Port => {
                let port_state = self.ports.get(origin.port.index());
                port_state.is_none_or(|port_state| port_state.generation() != origin.generation)
            }
            ReplyTo::Console => !self.direct_request.waits_for(origin.generation),
            // Nobody waits for a response, so nobody can be gone.
            ReplyTo::Nobody => false,
        }
    }

    /// Returns to the router a frame that holds its response.
    pub(crate) fn answered(&self, frame: Frame<'_>) {
        self.return_to_router(frame, Stage::Response);
    }

    /// Returns to the router a frame that gets no response.
    pub(crate) fn unanswered(&self, frame: Frame<'_>) {
        if frame.abandon() {
            return;
        }
        self.return_to_router(frame, Stage::Silence);
    }

    /// Answers a request with `exception`.
    pub(crate) fn refuse(&self, frame: Frame<'_>, exception: Exception) {
        // Still arriving: its sender sends it again once it is complete.
        if frame.abandon() {
            return;
        }
        // Fits: two bytes always do.
        let _ = frame.replace(&exception.response(frame.function()));
        self.answered(frame);
    }

    fn return_to_router(&self, frame: Frame<'_>, stage: Stage) {
        frame.set_stage(stage);
        self.inbox.send(frame);
    }
}
