//! the dispatcher of a client-side port: takes requests in from the port's channel, keeps them queued, and sees that every one
//! of them goes home with a response, also when the port is closed or set anew.
//!
//! Requests are taken in at once, also while another one is on the wire, so that refusals do not wait: a full queue is
//! answered 06h, a unit that is down 0Bh, a line that is not open 0Ah.
//!
//! A request that is carried out carries the identical reads that waited with it: their frames ride on its frame, and each gets
//! a copy of the response, or is repeated or refused by itself. Where rules allow it, reads of neighbouring addresses ride along
//! as well: the frame asks for all of them then, and each gets its part of the response. A unit that refuses that is asked
//! for each by itself, and so for a while.
//!
//! Where a rule allows it, a read is answered from memory ([`cache`](crate::port::client::cache)), unless a write to its unit waits
//! or is on its way.

mod combine;
mod dispatch;
mod entry;
mod next;
mod outcome;
mod proof;

use core::cell::{Cell, RefCell, RefMut};

use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::Instant;
use heapless::Vec;

use crate::frame::{Cause, Envelope, Frame, ReplyTo, Stage, Transaction};
use crate::gateway::outstanding::Purpose;
use crate::gateway::unit_health::{Care, Gate};
use crate::gateway::{Gateway, PortAt};
use crate::modbus::pdu::{self};
use crate::modbus::{Exception, Pdu};
use crate::port::client::cache::{Cache, Question};
use crate::port::client::dispatcher::combine::CombinedRead;
use crate::port::client::dispatcher::entry::{block, entry, requester};
use crate::port::client::pending::PENDING_MAX;
use crate::port::client::queue::{Access, BROADCAST, Entry, PortQueue, WAITING_MAX};
use crate::port::client::servers::{CONNECTIONS_MAX, Servers};
use crate::port::timer::until;
use crate::settings::{PortId, PortKind, SerialSettings};
use crate::stats::Event;

/// How often a full queue is looked through for requests that are nobody's any more. That takes longer than serving a request, and to refuse
/// one must take less.
const SWEEP_PAUSE_MS: u16 = 10;

/// Requests that one port carries out at a time: on each connection as many as may be open there, with the feature `small` on all of
/// them together.
const CURRENT_MAX: usize = if cfg!(feature = "small") { PENDING_MAX } else { PENDING_MAX * CONNECTIONS_MAX };

/// Requests of one client-side port, shared by the future that takes them in and the one that carries them out.
pub(crate) struct Dispatcher<'g> {
    gateway: &'g Gateway<'g>,
    port_state: PortAt<'g>,
    id: PortId,
    queue: RefCell<PortQueue<Frame<'g>>>,
    servers: RefCell<Servers>,
    /// Links that have servers, at most as many as there are servers.
    connections: u8,
    /// The unit that is asked whatever the rule says.
    unit: Option<u8>,
    /// A console has the port for itself: all others are refused.
    alone: bool,
    /// The requests that are being carried out.
    current: RefCell<Vec<Frame<'g>, CURRENT_MAX>>,
    cache: RefCell<Cache>,
    /// Far fewer end while one request is carried out than make it the same again.
    writes_ended: Cell<u16>,
    /// When it was last looked which requests are unwanted: the milliseconds of the clock, cut off.
    swept: Cell<u16>,
    /// For each connection: something changed, a request came or a unit's gate moved.
    changed: [Signal<NoopRawMutex, ()>; CONNECTIONS_MAX],
    /// Responses say which request they belong to.
    transaction_ids: bool,
    /// For each connection: what is sent before the request that was given out last.
    proofs: [Cell<Option<Proving>>; CONNECTIONS_MAX],
}

/// What a client-side port is besides its line.
pub(crate) struct Upstream {
    pub(crate) servers: Servers,
    /// Connections at a time.
    pub(crate) connections: u8,
    /// The unit that is asked whatever the rule says.
    pub(crate) unit: Option<u8>,
    /// Responses say which request they belong to.
    pub(crate) transaction_ids: bool,
}

/// The request that a request waits for.
#[derive(Debug, Clone, Copy)]
struct Proving {
    request: [u8; 5],
    purpose: Purpose,
}

impl<'g> Dispatcher<'g> {
    /// An empty dispatcher. It takes requests in while its line is being opened for the first time; they wait for that.
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
            changed: [const { Signal::new() }; CONNECTIONS_MAX],
            transaction_ids,
            proofs: [const { Cell::new(None) }; CONNECTIONS_MAX],
        }
    }

    /// The gateway that the port is one of.
    pub(crate) fn gateway(&self) -> &'g Gateway<'g> {
        self.gateway
    }

    /// The port's place in the settings.
    pub(crate) fn id(&self) -> PortId {
        self.id
    }

    /// Whether the console has the port for itself.
    pub(crate) fn is_alone(&self) -> bool {
        self.alone
    }

    /// The port's counters, units and channel.
    pub(crate) fn port_state(&self) -> &PortAt<'g> {
        &self.port_state
    }

    // One place for each cell that would panic if it were lent twice.

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

    /// Takes requests in for ever, and drops those whose time is over or whose requester is gone.
    pub(crate) async fn take_in(&self) {
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
        let mut envelope = frame.envelope();
        if let Some(target) = self.unit {
            envelope.target = target;
            frame.address(envelope);
        }
        let is_others = self.alone && envelope.origin.reply_to != ReplyTo::Console;
        if is_others || !self.servers().takes(envelope.target, envelope.paced) {
            return self.fail(frame, Event::NoPath, Exception::GATEWAY_NO_PATH);
        }
        let Some(frame) = self.respond_from_cache(frame, &envelope) else { return };
        if !envelope.paced && self.gate(envelope.target) == Gate::Down {
            return self.fail(frame, Event::UnitDown, Exception::GATEWAY_NO_RESPONSE);
        }
        let elapsed = || milliseconds(Instant::now()).wrapping_sub(self.swept.get());
        if self.queue().len() >= WAITING_MAX && elapsed() >= SWEEP_PAUSE_MS {
            // Some of them may be nobody's.
            self.sweep();
        }
        self.enqueue(frame, &envelope, PortQueue::push);
        self.count_waiting();
        self.tell(envelope.target);
    }

    /// Puts a request in the queue, and refuses the one for which there is no room then.
    fn enqueue(
        &self,
        frame: Frame<'g>,
        envelope: &Envelope,
        put: fn(&mut PortQueue<Frame<'g>>, Frame<'g>, Entry) -> Option<Frame<'g>>,
    ) {
        let entry = entry(envelope, frame.pdu(pdu::is_read));
        let refused = put(&mut self.queue(), frame, entry);
        if let Some(refused) = refused {
            self.fail(refused, Event::QueueFull, Exception::BUSY);
        }
    }

    /// Tells how many requests wait.
    fn count_waiting(&self) {
        self.port_state.set_waiting(self.queue().len());
    }

    /// What is to be sent for `request`: its request, or what has to be proved before.
    pub(crate) fn request(&self, request: &Frame<'g>) -> Pdu {
        let mut pdu = Pdu::new();
        // There is room: it is no longer than a PDU may be.
        self.with_request(request, |request| pdu.extend_from_slice(request).unwrap_or_default());
        pdu
    }

    /// Calls `look` with the [`Dispatcher::request`] for `request`, where it lies.
    pub(crate) fn with_request<R: Default>(&self, request: &Frame<'g>, read: impl FnOnce(&[u8]) -> R) -> R {
        match self.proof(request) {
            Some(proof) => read(&proof.request),
            None => request.pdu(read),
        }
    }

    /// The [`Dispatcher::request`] for `request` is sent to `unit` now.
    pub(crate) fn sent(&self, request: &Frame<'g>, unit: u8) {
        let purpose = self.proof(request).map_or(Purpose::Request, |proof| proof.purpose);
        let event = if purpose == Purpose::Request { Event::Request } else { Event::Proof };
        self.port_state.stats.count(event);
        if unit != BROADCAST {
            self.port_state.units(|units| {
                if purpose == Purpose::Request {
                    units.asked(unit);
                }
                if !self.transaction_ids {
                    self.with_request(request, |request| units.sent(unit, request, purpose));
                }
            });
        }
    }

    /// Lets the requests that can share the transaction of `leader` ride on it if its unit is `in_step`, and notes what its response is
    /// good for.
    fn start(&self, leader: &Frame<'g>, entry: &Entry, in_step: bool, now: Instant) -> Transaction {
        let asked = block(leader);
        let combined = if in_step { self.combine(leader, entry, now) } else { None };
        if let Some(combined) = combined.filter(|combined| Some(combined.block) != asked) {
            // A read is as long as another.
            let _ = leader.replace(&combined.block.request());
            // What comes is not the response yet.
            leader.address(Envelope { cut: false, ..leader.envelope() });
        }
        let serves = |frame: &Frame<'g>| Some(combined?.serves(&CombinedRead::of(frame)?));
        let joins = |frame: &Frame<'g>| {
            in_step
                && (frame.same_pdu(leader) || serves(frame) == Some(true))
                && !self.gateway.is_gone(frame.origin())
        };
        let mut block_for_all = None;
        let mut queue = self.queue();
        // From the last one on, each in front of the others: they ride in the order of arrival.
        while let Some(merged) = queue.companion(entry, joins) {
            let theirs = block(&merged);
            if theirs != asked {
                block_for_all = combined.map(|combined| combined.block);
            }
            if asked.zip(theirs).and_then(|(own, theirs)| own.hull(&theirs)) != asked {
                queue.charge(requester(&merged.envelope()));
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

    /// What is best asked for in place of `leader`, if its rule lets others join it.
    fn combine(&self, leader: &Frame<'g>, entry: &Entry, now: Instant) -> Option<CombinedRead> {
        let combined = CombinedRead::of(leader)?;
        let queue = self.queue();
        let is_there = |frame: &&Frame<'g>| !self.gateway.is_gone(frame.origin());
        let others = || queue.companions(entry).filter(is_there).filter_map(CombinedRead::of);
        let combines = self.port_state.units(|units| units.combines(entry.unit, now));
        if combines { Some(combined.combine_all(others)) } else { None }
    }

    /// Answers a read from memory if its rule allows that and a new enough answer is there; else gives it back.
    fn respond_from_cache(&self, frame: Frame<'g>, envelope: &Envelope) -> Option<Frame<'g>> {
        let Envelope { target, sharing, .. } = *envelope;
        if sharing.cache_ms == 0 {
            return Some(frame);
        }
        let Some(block) = block(&frame) else { return Some(frame) };
        let question = Question { unit: target, block };
        let cache = self.cache();
        let Some(response) = cache.response(question, Instant::now(), sharing.cache()) else {
            return Some(frame);
        };
        if self.is_writing(target) {
            return Some(frame);
        }
        // It fitted into a frame of the same size.
        let _ = frame.replace(response);
        self.port_state.stats.count(Event::Cached);
        self.gateway.answered(frame);
        None
    }

    /// Whether a write to `unit` waits or is being carried out.
    fn is_writing(&self, unit: u8) -> bool {
        let writes = |request: &Frame<'g>| {
            request.transaction().writes && [unit, BROADCAST].contains(&request.target())
        };
        self.queue().writes_to(unit) || self.current().iter().any(writes)
    }

    /// Opens the dispatcher: requests are queued.
    pub(crate) fn open(&self) {
        self.servers().open();
    }

    /// Closes the dispatcher: whatever was on the wire is answered 0Bh, whatever waits or comes 0Ah.
    pub(crate) fn close(&self) {
        self.servers().close();
        self.close_requests(None);
        while let Some(frame) = self.port_state.queue.try_receive(self.gateway.pool()) {
            self.fail(frame, Event::NoPath, Exception::GATEWAY_NO_PATH);
        }
    }

    /// What is on the wire for `server`, or for all, is answered 0Bh, what waits 0Ah.
    fn close_requests(&self, server: Option<usize>) {
        let which = |unit| server.is_none_or(|server| self.is_of(server, unit));
        self.cache().forget(which);
        loop {
            let mut current = self.current();
            let Some(at) = current.iter().position(|request| which(request.target())) else { break };
            let frame = current.swap_remove(at);
            drop(current);
            while let Some(merged) = frame.unload() {
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

/// The milliseconds of the clock, cut off.
fn milliseconds(now: Instant) -> u16 {
    now.as_millis() as u16
}

/// How a port of this `kind` treats `unit`, where responses have no transaction ids.
fn care(kind: &PortKind, unit: u8) -> Option<Care> {
    let (proofs, late_window) = match kind {
        PortKind::Serial(SerialSettings { client, .. }) => (&client.proofs, client.late_window()),
        PortKind::TcpClient(client) => (&client.proofs, client.late_window()),
        _ => return None,
    };
    Some(Care { proof: proofs.of(unit), late_window })
}

/// Whether whoever asked `request` has been given it while its response was still being written: it must not be sent home again.
pub(crate) fn is_responding(request: &Frame<'_>) -> bool {
    request.stage() == Stage::Responding
}
