//! The dispatcher of a client-side port: receives requests from the port's channel, queues them, and makes sure that each one
//! ends with a response or an exception, even when the port is closed or reconfigured.
//!
//! Requests are received at once, even while another is on the wire, so that refusals do not wait: 06h when the queue is full,
//! 0Bh for a unit that is down, 0Ah when the line is not open.
//!
//! Identical reads waiting for the same unit are merged into one transaction: their frames are linked to the frame of the request
//! that is sent (the leader), and each gets a copy of the response, or is repeated or refused on its own. Where rules allow it,
//! reads of neighbouring addresses are combined as well: one read covers them all and each gets its part. A unit that refuses a
//! combined read gets the reads one by one, and is not sent combined reads for a while.
//!
//! Where a rule allows it, a read is answered from the [`cache`](crate::port::client::cache), unless a write to its unit is
//! queued or in flight.

mod combine;
mod dispatch;
mod entry;
mod in_flight;
mod proof;

use core::cell::{Cell, RefCell, RefMut};

use embassy_futures::select::{Either, select};
use embassy_sync::waitqueue::WakerRegistration;
use embassy_time::Instant;
use heapless::Vec;

use crate::frame::{Cause, Frame, ReplyTo, Stage, Transaction};
use crate::gateway::outstanding::Purpose;
use crate::gateway::unit_health::{Care, Gate};
use crate::gateway::{Gateway, PortAt};
use crate::modbus::pdu::{self};
use crate::modbus::{Exception, Pdu};
use crate::port::client::cache::{Cache, CacheKey};
use crate::port::client::dispatcher::combine::CombinedRead;
use crate::port::client::dispatcher::entry::{block, entry, requester};
use crate::port::client::pending::PENDING_MAX;
use crate::port::client::queue::{Access, BROADCAST, Entry, PortQueue, WAITING_MAX};
use crate::port::client::servers::{CONNECTIONS_MAX, Servers};
use crate::port::timer::until;
use crate::settings::{PortId, PortKind, SerialSettings};
use crate::stats::Event;

/// Minimum time between two sweeps of a full queue. A sweep takes longer than serving a request; refusing one must be faster.
const SWEEP_PAUSE_MS: u16 = 10;

/// Requests in flight per port: the maximum of each connection, or with the feature `small` that of one connection for all
/// together.
const CURRENT_MAX: usize = if cfg!(feature = "small") { PENDING_MAX } else { PENDING_MAX * CONNECTIONS_MAX };

/// The requests of one client-side port, shared by the future that receives them and the one that sends them.
pub(crate) struct Dispatcher<'g> {
    gateway: &'g Gateway<'g>,
    port_state: PortAt<'g>,
    id: PortId,
    queue: RefCell<PortQueue<Frame<'g>>>,
    servers: RefCell<Servers>,
    /// Connections in use, at most one per server.
    connections: u8,
    /// Overrides the unit given by the rule.
    unit: Option<u8>,
    /// The console uses the port exclusively: all other requests are refused.
    alone: bool,
    /// The requests in flight.
    current: RefCell<Vec<Frame<'g>, CURRENT_MAX>>,
    cache: RefCell<Cache>,
    /// Writes completed so far. Wraps harmlessly: fewer writes end during one transaction.
    writes_ended: Cell<u16>,
    /// Time of the last sweep, as the low bits of the clock's milliseconds.
    swept: Cell<u16>,
    /// A unit has been down.
    saw_down: Cell<bool>,
    /// Per connection: whether a request arrived or a unit's state changed.
    changed: [Cell<bool>; CONNECTIONS_MAX],
    /// The port's task, where a connection has to be told of a change by one that is polled later.
    task: RefCell<WakerRegistration>,
    /// Responses carry transaction ids.
    transaction_ids: bool,
    /// Per connection: the proof to send before the request served last.
    proofs: [Cell<Option<Proving>>; CONNECTIONS_MAX],
}

/// The parameters of a client-side port besides its line.
pub(crate) struct Upstream {
    pub(crate) servers: Servers,
    /// Simultaneous connections.
    pub(crate) connections: u8,
    /// Overrides the unit given by the rule.
    pub(crate) unit: Option<u8>,
    /// Responses carry transaction ids.
    pub(crate) transaction_ids: bool,
}

/// The proof that a request waits for.
#[derive(Debug, Clone, Copy)]
struct Proving {
    request: [u8; 5],
    purpose: Purpose,
}

impl<'g> Dispatcher<'g> {
    /// An empty dispatcher. While the line is opened for the first time, requests are queued.
    pub(crate) fn new(
        gateway: &'g Gateway<'g>,
        port_state: PortAt<'g>,
        id: PortId,
        part: Upstream,
        alone: bool,
    ) -> Self {
        let Upstream { servers, connections, unit, transaction_ids } = part;
        Self {
            gateway,
            port_state,
            id,
            queue: RefCell::new(PortQueue::new()),
            servers: RefCell::new(servers),
            connections,
            unit,
            alone,
            current: RefCell::new(Vec::new()),
            cache: RefCell::new(Cache::new()),
            writes_ended: Cell::new(0),
            swept: Cell::new(0),
            saw_down: Cell::new(false),
            changed: [const { Cell::new(false) }; CONNECTIONS_MAX],
            task: RefCell::new(WakerRegistration::new()),
            transaction_ids,
            proofs: [const { Cell::new(None) }; CONNECTIONS_MAX],
        }
    }

    /// The gateway this port belongs to.
    pub(crate) fn gateway(&self) -> &'g Gateway<'g> {
        self.gateway
    }

    /// The port's index in the settings.
    pub(crate) fn id(&self) -> PortId {
        self.id
    }

    /// Whether the console uses the port exclusively.
    pub(crate) fn is_alone(&self) -> bool {
        self.alone
    }

    /// The port's counters, units and channel.
    pub(crate) fn port_state(&self) -> &PortAt<'g> {
        &self.port_state
    }

    // Only these functions borrow the cells, so that none is borrowed twice.

    fn queue(&self) -> RefMut<'_, PortQueue<Frame<'g>>> {
        self.queue.borrow_mut()
    }

    fn current(&self) -> RefMut<'_, Vec<Frame<'g>, CURRENT_MAX>> {
        self.current.borrow_mut()
    }

    fn cache(&self) -> RefMut<'_, Cache> {
        self.cache.borrow_mut()
    }

    fn servers(&self) -> RefMut<'_, Servers> {
        self.servers.borrow_mut()
    }

    /// Receives requests forever, and drops those that expired or whose requester is gone. To be polled before the connections.
    pub(crate) async fn receive_requests(&self) -> ! {
        loop {
            let deadline = self.queue().first_deadline().unwrap_or(Instant::MAX);
            let due = deadline.min(self.make_room());
            match select(self.port_state.queue.receive(self.gateway.pool()), until(due)).await {
                Either::First(frame) => self.admit(frame),
                Either::Second(()) => self.sweep(),
            }
        }
    }

    fn admit(&self, frame: Frame<'g>) {
        if let Some(target) = self.unit {
            frame.amend(|envelope| envelope.target = target);
        }
        let (target, paced, reply_to) =
            frame.read(|envelope| (envelope.target, envelope.paced, envelope.origin.reply_to));
        let is_others = self.alone && reply_to != ReplyTo::Console;
        if is_others || !self.servers().takes(target, paced) {
            return self.fail(frame, Event::NoPath, Exception::GATEWAY_NO_PATH);
        }
        let Some(frame) = self.respond_from_cache(frame) else { return };
        if !paced && self.gate(target) == Gate::Down {
            return self.fail(frame, Event::UnitDown, Exception::GATEWAY_NO_RESPONSE);
        }
        let elapsed = || milliseconds(Instant::now()).wrapping_sub(self.swept.get());
        if self.queue().len() >= WAITING_MAX && elapsed() >= SWEEP_PAUSE_MS {
            // Makes room if some have expired or been abandoned.
            self.sweep();
        }
        self.enqueue(frame, PortQueue::push);
        self.count_waiting();
        self.notify(target);
    }

    /// Queues a request; one that is evicted for it, or cannot be queued, is refused.
    fn enqueue(
        &self,
        frame: Frame<'g>,
        put: fn(&mut PortQueue<Frame<'g>>, Frame<'g>, Entry) -> Option<Frame<'g>>,
    ) {
        let is_read = frame.pdu(pdu::is_read);
        let entry = frame.read(|envelope| entry(envelope, is_read));
        let refused = put(&mut self.queue(), frame, entry);
        if let Some(refused) = refused {
            self.fail(refused, Event::QueueFull, Exception::BUSY);
        }
    }

    /// Publishes the number of waiting requests.
    fn count_waiting(&self) {
        self.port_state.set_waiting(self.queue().len());
    }

    /// The PDU to send for `request`: its own, or the proof sent ahead of it.
    pub(crate) fn request(&self, request: &Frame<'g>) -> Pdu {
        let mut pdu = Pdu::new();
        // Fits: no longer than a PDU may be.
        self.with_request(request, |request| pdu.extend_from_slice(request).unwrap_or_default());
        pdu
    }

    /// Calls `read` with the PDU to send for `request`, without copying it.
    pub(crate) fn with_request<R: Default>(&self, request: &Frame<'g>, read: impl FnOnce(&[u8]) -> R) -> R {
        read_request(request, self.proof(request), read)
    }

    /// Records that the PDU for `request` is being sent to `unit`.
    pub(crate) fn sent(&self, request: &Frame<'g>, unit: u8) {
        let proof = self.proof(request);
        let purpose = proof.map_or(Purpose::Request, |proof| proof.purpose);
        let event = if purpose == Purpose::Request { Event::Request } else { Event::Proof };
        self.port_state.stats.count(event);
        if unit != BROADCAST {
            self.port_state.units(|units| match self.transaction_ids {
                true => units.asked(unit),
                false => read_request(request, proof, |request| units.sent(unit, request, purpose)),
            });
        }
    }

    /// Starts a transaction for `leader`. If its unit is `in_step`, the waiting reads that can share it are merged into it.
    fn start(&self, leader: &Frame<'g>, entry: &Entry, in_step: bool, now: Instant) -> Transaction {
        let asked = block(leader);
        let combined = if in_step { self.combine(leader, entry, now) } else { None };
        if let Some(combined) = combined.filter(|combined| Some(combined.block) != asked) {
            // Fits: all reads have the same length.
            let _ = leader.replace(&combined.block.request());
            // Cut-through is off: the response covers more than the leader asked for.
            leader.amend(|envelope| envelope.cut = false);
        }
        let serves = |frame: &Frame<'g>| Some(combined?.serves(&CombinedRead::of(frame)?));
        let joins = |frame: &Frame<'g>| {
            in_step
                && (frame.same_pdu(leader) || serves(frame) == Some(true))
                && !self.gateway.is_gone(frame.origin())
        };
        let mut block_for_all = None;
        let mut queue = self.queue();
        // Taken from the back and linked at the front, which keeps the order of arrival.
        while let Some(merged) = queue.companion(entry, joins) {
            let theirs = block(&merged);
            if theirs != asked {
                block_for_all = combined.map(|combined| combined.block);
            }
            if asked.zip(theirs).and_then(|(own, theirs)| own.hull(&theirs)) != asked {
                queue.charge(merged.read(requester));
            }
            leader.merge(merged);
        }
        Transaction {
            writes: entry.access == Access::Write,
            asked,
            combined: block_for_all,
            since: now,
            writes_ended: self.writes_ended.get(),
        }
    }

    /// The combined read to send in place of `leader`, if its rule allows combining.
    fn combine(&self, leader: &Frame<'g>, entry: &Entry, now: Instant) -> Option<CombinedRead> {
        let combined = CombinedRead::of(leader)?;
        let queue = self.queue();
        let is_there = |frame: &&Frame<'g>| !self.gateway.is_gone(frame.origin());
        let others = || queue.companions(entry).filter(is_there).filter_map(CombinedRead::of);
        let combines = self.port_state.units(|units| units.combines(entry.unit, now));
        if combines { Some(combined.combine_all(others)) } else { None }
    }

    /// Answers a read from the cache if its rule allows it and the cached response is fresh; otherwise returns it.
    fn respond_from_cache(&self, frame: Frame<'g>) -> Option<Frame<'g>> {
        let (target, sharing) = frame.read(|envelope| (envelope.target, envelope.sharing));
        if sharing.cache_ms == 0 {
            return Some(frame);
        }
        let Some(block) = block(&frame) else { return Some(frame) };
        let key = CacheKey { unit: target, block };
        let cache = self.cache();
        let Some(response) = cache.response(key, Instant::now(), sharing.cache()) else {
            return Some(frame);
        };
        if self.is_writing(target) {
            return Some(frame);
        }
        // Fits: it came from a frame of the same size.
        let _ = frame.replace(response);
        self.port_state.stats.count(Event::Cached);
        self.gateway.answered(frame);
        None
    }

    /// Whether a write to `unit` is queued or in flight.
    fn is_writing(&self, unit: u8) -> bool {
        let writes = |request: &Frame<'g>| {
            request.transaction().writes && [unit, BROADCAST].contains(&request.target())
        };
        self.queue().writes_to(unit) || self.current().iter().any(writes)
    }

    /// Opens the port: requests are queued.
    pub(crate) fn open(&self) {
        self.servers().open();
    }

    /// Closes the port: requests on the wire get 0Bh; waiting and new ones get 0Ah.
    pub(crate) fn close(&self) {
        self.servers().close();
        self.close_requests(None);
        while let Some(frame) = self.port_state.queue.try_receive(self.gateway.pool()) {
            self.fail(frame, Event::NoPath, Exception::GATEWAY_NO_PATH);
        }
    }

    /// Requests on the wire for `server`, or for all servers, get 0Bh; waiting ones get 0Ah.
    fn close_requests(&self, server: Option<usize>) {
        let which = |unit| server.is_none_or(|server| self.is_of(server, unit));
        self.cache().forget(which);
        loop {
            let mut current = self.current();
            let Some(at) = current.iter().position(|request| which(request.target())) else { break };
            let frame = current.swap_remove(at);
            drop(current);
            while let Some(merged) = frame.take_merged() {
                self.give_up(merged);
            }
            self.give_up(frame);
        }
        let of_these = |_: &Frame<'g>, entry: &Entry| which(entry.unit).then_some(Event::NoPath);
        while let Some((frame, event)) = self.queue().take_if(of_these) {
            self.fail(frame, event, Exception::GATEWAY_NO_PATH);
        }
        self.count_waiting();
    }

    fn fail(&self, frame: Frame<'g>, event: Event, exception: Exception) {
        self.port_state.stats.count(event);
        log_debug!("port {}: {} for unit {}", self.id.0, event.name(), frame.target());
        frame.blame(Cause::Unsent);
        self.gateway.refuse(frame, exception);
    }
}

/// Calls `read` with the PDU of the `proof` that goes ahead of `request`, or with its own.
fn read_request<R: Default>(request: &Frame<'_>, proof: Option<Proving>, read: impl FnOnce(&[u8]) -> R) -> R {
    match proof {
        Some(proof) => read(&proof.request),
        None => request.pdu(read),
    }
}

/// The low bits of the clock's milliseconds.
fn milliseconds(now: Instant) -> u16 {
    now.as_millis() as u16
}

/// How a port of this `kind` proves `unit` in step, for protocols without transaction ids.
fn care(kind: &PortKind, unit: u8) -> Option<Care> {
    let (proofs, late_window) = match kind {
        PortKind::Serial(SerialSettings { client, .. }) => (&client.proofs, client.late_window()),
        PortKind::TcpClient(client) => (&client.proofs, client.late_window()),
        _ => return None,
    };
    Some(Care { proof: proofs.of(unit), late_window })
}

/// Whether the response is already being forwarded to the requester: it must not be sent a second time.
pub(crate) fn is_responding(request: &Frame<'_>) -> bool {
    request.stage() == Stage::Responding
}
