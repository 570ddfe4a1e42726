//! The gateway: what all tasks share, and the futures that a board runs as its tasks.
//!
//! A board keeps the frame pool, the port places and the seats in statics of their own, builds a [`Gateway`] over
//! them, and runs [`Gateway::route`] once, [`Gateway::run_port`] for every port place and [`Gateway::run_seat`] for
//! every TCP connection that it can hold. [`Gateway::apply`] takes settings over and restarts what differs.

use core::cell::RefCell;
use core::pin::pin;
use core::sync::atomic::AtomicBool;
use core::sync::atomic::Ordering::Relaxed;

use embassy_futures::select::select;
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::Instant;

use crate::asking::Asking;
use crate::capture::{CAPTURE, Capture};
use crate::config::{
    OwnNetwork, PORTS_MAX, Port, PortId, PortKind, Reloaded, SERVERS_MAX, Settings, Side, StreamFraming,
    load_points,
};
use crate::drafting::Draft;
use crate::frame::{Channel, Envelope, Frame, FramePool, FrameWriter, Origin, Stage, Way};
use crate::hal::{SerialHost, TcpConnect, TcpHost, UdpHost};
use crate::modbus::Exception;
use crate::port::desk::{Desk, Part};
use crate::port::ethercat::EthercatPlace;
use crate::port::local::Events;
use crate::port::moment::apart;
use crate::port::servers::{LINKS_MAX, Servers};
use crate::port::tcp_server::{Terms, Turns};
use crate::port::units::AllUnits;
use crate::port::{scanner, serial_client, serial_server, tcp_client, tcp_server, udp_server};
use crate::scanner::{POINTS, ScannerPlace};
use crate::stats::Log;

mod check;
mod ethercat;
mod place;
mod seat;

pub use self::check::ApplyError;
use self::place::ServerPlace;
pub use self::place::{PortAt, PortPlace, Ports, Status};
pub use self::seat::{Seat, SeatState};

type Shared<T> = Mutex<CriticalSectionRawMutex, RefCell<T>>;

/// All that the tasks share.
pub struct Gateway<'g> {
    pool: &'g FramePool<'g>,
    ports: &'g [PortPlace],
    units: &'g Shared<AllUnits>,
    servers: &'g [ServerPlace],
    seats: &'g [Seat],
    /// The global queue: every port sends, only the router receives.
    pub(crate) inbox: Channel,
    settings: Shared<Settings>,
    /// Settings that are being changed, loaded or saved.
    pub(crate) draft: Draft,
    /// Whether the settings in force are others than those that were loaded or saved last.
    unsaved: AtomicBool,
    /// Whether two names are one serial line's.
    same_device: fn(&str, &str) -> bool,
    /// Whether the settings say the board's own address.
    owns_network: bool,
    network_changed: Signal<CriticalSectionRawMutex, ()>,
    mdns_changed: Signal<CriticalSectionRawMutex, ()>,
    log: Log,
    /// Whose requests are refused share these.
    pub(crate) turns: Turns,
    /// What a console asks past the rules.
    pub(crate) asking: Asking,
    /// What the own unit has done.
    events: Shared<Events>,
    scanner: Option<&'g ScannerPlace>,
    capture: Option<&'g Capture>,
    ethercat: Option<&'g EthercatPlace>,
    /// Whether the settings say at which network interface its controller is.
    ethercat_interfaces: bool,
    ethercat_changed: Signal<CriticalSectionRawMutex, ()>,
}

impl<'g> Gateway<'g> {
    /// A gateway without settings over a board's frames, port places and seats. The pool reserves a frame for each
    /// seat first, then for each port.
    pub const fn new<const N: usize>(
        pool: &'g FramePool<'g>,
        ports: &'g Ports<N>,
        seats: &'g [Seat],
    ) -> Self {
        Self {
            pool,
            ports: &ports.places,
            units: &ports.units,
            servers: &ports.servers,
            seats,
            inbox: Channel::new(),
            settings: Mutex::new(RefCell::new(Settings::new())),
            draft: Draft::new(Settings::new()),
            unsaved: AtomicBool::new(false),
            same_device: |one, other| one == other,
            owns_network: false,
            network_changed: Signal::new(),
            mdns_changed: Signal::new(),
            log: Log::new(),
            turns: Turns::new(),
            asking: Asking::new(),
            events: Mutex::new(RefCell::new(Events::new())),
            scanner: None,
            capture: None,
            ethercat: None,
            ethercat_interfaces: false,
            ethercat_changed: Signal::new(),
        }
    }

    /// For a board whose serial lines have several names each: it says whether two of them are one line's.
    #[must_use]
    pub const fn with_same_device(mut self, same_device: fn(&str, &str) -> bool) -> Self {
        self.same_device = same_device;
        self
    }

    /// The gateway with data points, which take memory of their own.
    #[must_use]
    pub const fn with_scanner(mut self, scanner: &'g ScannerPlace) -> Self {
        self.scanner = Some(scanner);
        self
    }

    /// The gateway with a ring of the last frames, which takes memory of its own.
    #[must_use]
    pub const fn with_capture(mut self, capture: &'g Capture) -> Self {
        self.capture = Some(capture);
        self
    }

    /// The last frames of the serial lines, if the board has memory for them.
    pub fn capture(&self) -> Option<&'g Capture> {
        if CAPTURE { self.capture } else { None }
    }

    /// The data points, if the board has memory for them. Point N of the settings is row N, device N is device N.
    pub fn scanner(&self) -> Option<&'g ScannerPlace> {
        if POINTS { self.scanner } else { None }
    }

    /// For a board whose Ethernet is the gateway's own: the settings say its address, and the board follows them by
    /// [`new_network`](Self::new_network). Elsewhere such settings are refused.
    pub const fn with_own_network(mut self) -> Self {
        self.owns_network = true;
        self
    }

    /// Waits until the settings say another way to come by the board's address; one task may wait.
    pub async fn new_network(&self) -> OwnNetwork {
        self.network_changed.wait().await;
        self.settings(Settings::own_network)
    }

    /// Waits until multicast DNS may have something else to say: another name or other servers; one task may wait.
    pub async fn new_mdns(&self) {
        self.mdns_changed.wait().await;
    }

    /// The frames.
    pub fn pool(&self) -> &'g FramePool<'g> {
        self.pool
    }

    /// The port places; a port's id is its index.
    pub fn ports(&self) -> &'g [PortPlace] {
        self.ports
    }

    /// The port place `id`, if the board has it.
    pub fn place(&self, id: PortId) -> Option<PortAt<'g>> {
        Some(PortAt { place: self.ports.get(id.index())?, units: self.units, id })
    }

    /// All of them, with the units behind each.
    pub fn places(&self) -> impl Iterator<Item = PortAt<'g>> {
        (0..self.ports.len()).filter_map(|index| self.place(PortId(index as u8)))
    }

    /// How the server of this line of the settings is doing, of which `new` is noted before if that is said.
    pub(crate) fn server_status(&self, place: usize, new: Option<Status>) -> Option<Status> {
        let place = self.servers.get(place)?;
        Some(place.lock(|status| new.map_or_else(|| status.get(), |new| status.replace(new))))
    }

    /// The places for TCP connections.
    pub fn seats(&self) -> &'g [Seat] {
        self.seats
    }

    /// The last transactions.
    pub fn log(&self) -> &Log {
        &self.log
    }

    /// Calls `f` with what the own unit has done.
    pub(crate) fn events<R>(&self, f: impl FnOnce(&mut Events) -> R) -> R {
        self.events.lock(|events| f(&mut events.borrow_mut()))
    }

    /// Calls `f` with the settings in force.
    pub fn settings<R>(&self, f: impl FnOnce(&Settings) -> R) -> R {
        self.settings.lock(|settings| f(&settings.borrow()))
    }

    /// Whether the settings have changed since they were loaded or saved.
    pub fn has_unsaved(&self) -> bool {
        self.unsaved.load(Relaxed)
    }

    /// Notes whether they have; gives what was noted before.
    pub fn set_unsaved(&self, unsaved: bool) -> bool {
        let before = self.has_unsaved();
        self.unsaved.store(unsaved, Relaxed);
        before
    }

    /// Changes the settings in force. Who changes more than what is looked up for each request tells the ports of it.
    pub(crate) fn change_settings<R>(&self, f: impl FnOnce(&mut Settings) -> R) -> R {
        self.settings.lock(|settings| f(&mut settings.borrow_mut()))
    }

    /// Takes `new` over: rules and what special units mean from the next request on; ports that differ in kind or its
    /// settings are started again, the others go on.
    pub fn apply(&self, new: &Settings) -> Result<(), ApplyError> {
        self.check(new)?;
        let mut points = Reloaded::Nothing;
        if let Some(place) = self.scanner() {
            let load = |scanner: &mut _| self.settings(|old| load_points(scanner, old, new, Instant::now()));
            points = place.change(load)?;
        }
        let mut changed = [false; PORTS_MAX];
        let other_slaves = self.settings(|settings| settings.slaves != new.slaves);
        self.settings.lock(|settings| {
            let mut settings = settings.borrow_mut();
            for (changed, (old, new)) in changed.iter_mut().zip(settings.ports.iter().zip(&new.ports)) {
                // A name or what special units mean is looked up anew for each request.
                *changed = old.as_ref().map(|port| &port.kind) != new.as_ref().map(|port| &port.kind);
                // What it has asked so far is nobody's question any more.
                *changed |= points == Reloaded::All && new.as_ref().is_some_and(is_scanner);
            }
            for (index, changed) in changed.iter_mut().enumerate() {
                let id = PortId(index as u8);
                let [old, new] =
                    [&settings, new].map(|settings| settings.servers_of(id).map(|(_, line)| line));
                *changed |= !old.eq(new);
            }
            self.move_server_statuses(&settings, new);
            if settings.own_network() != new.own_network() {
                self.network_changed.signal(());
            }
            if settings.mdns != new.mdns || settings.network != new.network || settings.ports != new.ports {
                self.mdns_changed.signal(());
            }
            settings.clone_from(new);
        });
        self.follow_ethercat(new, other_slaves);
        for place in self.places().filter(|place| changed.get(place.id.index()) == Some(&true)) {
            let id = place.id;
            let old = self.seats.iter().filter(|seat| seat.state().port == Some(id));
            old.for_each(|seat| seat.give_to(None));
            place.restart();
        }
        for (index, port) in new.ports.iter().enumerate() {
            if let (Some(port), Some(true)) = (port, changed.get(index)) {
                let free = self.seats.iter().filter(|seat| seat.state().port.is_none());
                free.take(seats_of(&port.kind)).for_each(|seat| seat.give_to(Some(PortId(index as u8))));
            }
        }
        Ok(())
    }

    /// How servers are doing is noted by the places of their lines: where those move, it moves with them.
    fn move_server_statuses(&self, old: &Settings, new: &Settings) {
        let mut statuses = [Status::Off; SERVERS_MAX];
        for (status, line) in statuses.iter_mut().zip(&new.servers) {
            let before = old.servers.iter().position(|before| before == line);
            *status = before.and_then(|place| self.server_status(place, None)).unwrap_or(Status::Off);
        }
        for (place, status) in statuses.into_iter().enumerate() {
            self.server_status(place, Some(status));
        }
    }

    /// The port task of place `id`: plays the part that the settings say, for ever.
    ///
    /// `lines` opens serial lines, `connector` makes connections, `datagrams` opens UDP sockets. An `async fn` would keep what it
    /// is given twice, at each port.
    pub fn run_port<H: SerialHost, C: TcpConnect, U: UdpHost>(
        &self,
        id: PortId,
        lines: &mut H,
        connector: &C,
        datagrams: &mut U,
    ) -> impl Future<Output = ()> {
        let at = self.place(id);
        async move {
            let Some(at) = at else { return };
            let place = at.place();
            loop {
                let mut kind = self.settings(|settings| settings.port(id).cloned()).map(|port| port.kind);
                let alone = self.asking.try_on(id, kind.as_mut());
                at.units(|units| units.freeze(alone));
                place.renew();
                match &kind {
                    Some(PortKind::Serial(settings)) if settings.side == Side::Server => {
                        let never_underruns = lines.never_underruns();
                        let server =
                            serial_server::Server { gateway: self, place, id, settings, never_underruns };
                        select(place.changed.wait(), server.run(lines)).await;
                        server.close();
                    }
                    Some(PortKind::UdpServer(settings)) => {
                        let server = udp_server::Server::new(self, place, id, settings);
                        select(place.changed.wait(), apart(pin!(server.run(datagrams)))).await;
                        server.close();
                    }
                    Some(PortKind::Scanner | PortKind::Ethercat(_)) => {
                        let ethercat = self.ethercat().filter(|_| kind != Some(PortKind::Scanner));
                        scanner::run(self, place, id, ethercat).await;
                    }
                    kind => {
                        let desk = Desk::new(self, at, id, self.part(id, kind), alone);
                        let part = play(&desk, kind.as_ref(), lines, connector);
                        select(place.changed.wait(), select(desk.take_in(), part)).await;
                        desk.close();
                        place.sockets.iter().for_each(|socket| socket.closed(self.ports));
                    }
                }
            }
        }
    }

    /// What the client-side port `id` is besides its line.
    fn part(&self, id: PortId, kind: &Option<PortKind>) -> Part {
        match kind {
            Some(PortKind::TcpClient(client)) => {
                let servers = match client.server {
                    Some(_) => Servers::one(),
                    None => self.settings(|settings| {
                        Servers::new(settings.servers_of(id).map(|(_, server)| (server.units, server.tag)))
                    }),
                };
                let links = usize::from(client.sockets).min(LINKS_MAX).min(servers.len()) as u8;
                let transaction_ids = client.framing == StreamFraming::Mbap;
                Part { servers, links, unit: client.unit, transaction_ids }
            }
            _ => Part { servers: Servers::line(), links: 1, unit: None, transaction_ids: false },
        }
    }

    /// The task of the seat `index`: serves one TCP client after the other, for ever. An `async fn` would keep what it is given
    /// twice, at each seat.
    pub fn run_seat<H: TcpHost>(&self, index: usize, host: &mut H) -> impl Future<Output = ()> {
        let seat = self.seats.get(index);
        async move {
            let Some(seat) = seat else { return };
            loop {
                let served = seat.state().port.and_then(|id| {
                    let terms = self.settings(|settings| settings.tcp_server(id).map(Terms::of))?;
                    Some((id, self.ports.get(id.index())?, terms))
                });
                let Some((id, place, terms)) = &served else {
                    seat.changed.wait().await;
                    continue;
                };
                let (id, settings) = (*id, terms);
                let server = tcp_server::Server { gateway: self, id, place, settings, seat, index };
                select(seat.changed.wait(), server.run(host)).await;
                server.left();
            }
        }
    }

    /// A frame for what the port `id` itself hears; its seats take theirs by their own numbers.
    pub(crate) fn take_for_port(&self, id: PortId) -> Option<(FrameWriter<'g>, Frame<'g>)> {
        // The pool's first frames are the seats', the next are the ports'.
        self.pool.take(self.seats.len() + id.index())
    }

    /// The same with all of what was heard.
    pub(crate) fn fill_for_port(&self, id: PortId, pdu: &[u8], envelope: Envelope) -> Option<Frame<'g>> {
        self.pool.fill(self.seats.len() + id.index(), pdu, envelope)
    }

    /// Whether an answer to `origin` would find nobody.
    pub(crate) fn is_gone(&self, origin: Origin) -> bool {
        match origin.way {
            Way::Seat(seat) => {
                let is_gone =
                    |seat: &mut SeatState| seat.generation != origin.generation || seat.peer.is_none();
                self.seats.get(usize::from(seat)).is_none_or(|seat| seat.update(is_gone))
            }
            Way::Line | Way::Port => {
                let place = self.ports.get(origin.port.index());
                place.is_none_or(|place| place.generation() != origin.generation)
            }
            Way::Console => !self.asking.waits_for(origin.generation),
            // Nobody waits, so nobody can have gone.
            Way::Nobody => false,
        }
    }

    /// Sends a frame home whose PDU is the answer by now.
    pub(crate) fn answered(&self, frame: Frame<'_>) {
        self.send_home(frame, Stage::Answer);
    }

    /// Sends a frame home that gets no answer.
    pub(crate) fn unanswered(&self, frame: Frame<'_>) {
        if frame.abandon() {
            return;
        }
        self.send_home(frame, Stage::Silence);
    }

    /// Answers a request with `exception`.
    pub(crate) fn refuse(&self, frame: Frame<'_>, exception: Exception) {
        // A request that is still arriving: whoever sent it sends it again when it is whole, and can be answered.
        if frame.abandon() {
            return;
        }
        // Two bytes always fit.
        let _ = frame.replace(&exception.response(frame.function()));
        self.answered(frame);
    }

    fn send_home(&self, frame: Frame<'_>, stage: Stage) {
        frame.set_stage(stage);
        self.inbox.send(frame);
    }
}

fn is_scanner(port: &Port) -> bool {
    matches!(port.kind, PortKind::Scanner)
}

/// Connections that a port needs: its clients, and one that is accepted to decide who goes.
fn seats_of(kind: &PortKind) -> usize {
    match kind {
        PortKind::TcpServer(server) => usize::from(server.clients) + 1,
        PortKind::Serial(_) | PortKind::TcpClient(_) | PortKind::UdpServer(_) => 0,
        PortKind::Scanner | PortKind::Ethercat(_) => 0,
    }
}

/// The part that a client-side port plays besides taking orders in.
async fn play<H: SerialHost, C: TcpConnect>(
    desk: &Desk<'_>,
    kind: Option<&PortKind>,
    lines: &mut H,
    connector: &C,
) {
    match kind {
        Some(PortKind::Serial(settings)) => {
            serial_client::run(desk, settings, lines).await;
        }
        Some(PortKind::TcpClient(settings)) => {
            apart(pin!(tcp_client::run(desk, settings, connector))).await;
        }
        Some(PortKind::TcpServer(_) | PortKind::UdpServer(_) | PortKind::Scanner | PortKind::Ethercat(_))
        | None => {
            desk.close();
            core::future::pending().await
        }
    }
}
