//! The desk of a client-side port: takes orders in from the port's channel, keeps them queued, and sees that every one
//! of them goes home with an answer, also when the port is closed or set anew.
//!
//! Orders are taken in at once, also while another one is on the wire, so that refusals do not wait: a full queue is
//! answered 06h, a unit that is down 0Bh, a line that is not open 0Ah.

use core::cell::{Cell, RefCell};

use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Instant, Timer};

use crate::config::PortId;
use crate::frame::{Envelope, Frame, Way};
use crate::gateway::{Gateway, PortPlace};
use crate::modbus::Exception;
use crate::port::queue::{Asker, Next, PortQueue, Ready, Ticket};
use crate::port::units::Gate;
use crate::stats::Event;

/// Orders of one client-side port, shared by the future that takes them in and the one that carries them out.
pub(crate) struct Desk<'g> {
    gateway: &'g Gateway<'g>,
    place: &'g PortPlace,
    id: PortId,
    queue: RefCell<PortQueue<Frame<'g>>>,
    /// The order that is being carried out.
    current: RefCell<Option<Frame<'g>>>,
    open: Cell<bool>,
    /// Something changed: an order came or a unit's gate moved.
    arrived: Signal<NoopRawMutex, ()>,
}

impl<'g> Desk<'g> {
    /// An empty desk. It takes orders in while its line is being opened for the first time; they wait for that.
    pub(crate) fn new(gateway: &'g Gateway<'g>, place: &'g PortPlace, id: PortId) -> Self {
        Self {
            gateway,
            place,
            id,
            queue: RefCell::new(PortQueue::new()),
            current: RefCell::new(None),
            open: Cell::new(true),
            arrived: Signal::new(),
        }
    }

    /// The port's counters, units and channel.
    pub(crate) fn place(&self) -> &'g PortPlace {
        self.place
    }

    /// Takes orders in for ever, and drops those whose time is over or whose asker is gone.
    pub(crate) async fn take_in(&self) {
        loop {
            let deadline = self.queue.borrow().first_deadline().unwrap_or(Instant::MAX);
            match select(self.place.queue.receive(self.gateway.pool()), Timer::at(deadline)).await {
                Either::First(frame) => self.admit(frame),
                Either::Second(()) => self.sweep(),
            }
        }
    }

    fn admit(&self, frame: Frame<'g>) {
        let envelope = frame.envelope();
        if !self.open.get() {
            return self.fail(frame, Event::NoPath, Exception::GATEWAY_NO_PATH);
        }
        if self.gate(envelope.target) == Gate::Down {
            return self.fail(frame, Event::UnitDown, Exception::GATEWAY_NO_RESPONSE);
        }
        let refused = self.queue.borrow_mut().push(frame, ticket(&envelope));
        if let Some(refused) = refused {
            self.fail(refused, Event::QueueFull, Exception::BUSY);
        }
        self.arrived.signal(());
    }

    /// Sends home what must not be sent any more.
    fn sweep(&self) {
        let now = Instant::now();
        loop {
            let unwanted = self.queue.borrow_mut().take_if(|frame, ticket| {
                if self.gateway.is_gone(frame.envelope().origin) {
                    Some(Event::AskerGone)
                } else if ticket.deadline <= now {
                    Some(Event::Expired)
                } else if self.gate(ticket.unit) == Gate::Down {
                    Some(Event::UnitDown)
                } else {
                    None
                }
            });
            match unwanted {
                Some((frame, event)) => self.fail(frame, event, Exception::GATEWAY_NO_RESPONSE),
                None => return,
            }
        }
    }

    /// The next order, which becomes the current one.
    pub(crate) fn next(&self) -> Next<Frame<'g>> {
        self.sweep();
        let ready = |unit| match self.gate(unit) {
            Gate::Open(ready) => ready,
            Gate::Down => Ready::Now,
        };
        let next = self.queue.borrow_mut().next(Instant::now(), ready);
        if let Next::Serve(frame, _) = &next {
            self.current.replace(Some(frame.share()));
        }
        next
    }

    /// Waits until [`Desk::next`] may have something new to say.
    pub(crate) async fn changed(&self) {
        self.arrived.wait().await;
    }

    /// Sends the current order home with what it holds by now as its answer.
    pub(crate) fn done(&self) {
        if let Some(frame) = self.current.take() {
            self.gateway.answered(frame);
        }
    }

    /// Sends the current order home without an answer: a broadcast.
    pub(crate) fn done_silently(&self) {
        if let Some(frame) = self.current.take() {
            self.gateway.finish_broadcast(frame);
        }
    }

    /// Answers the current order with `exception`.
    pub(crate) fn failed(&self, exception: Exception) {
        if let Some(frame) = self.current.take() {
            self.gateway.refuse(frame, exception);
        }
    }

    /// Puts the current order back in the queue, for a repeat.
    pub(crate) fn again(&self) {
        if let Some(frame) = self.current.take() {
            let ticket = ticket(&frame.envelope());
            if let Some(refused) = self.queue.borrow_mut().push(frame, ticket) {
                self.fail(refused, Event::QueueFull, Exception::BUSY);
            }
        }
    }

    /// Opens the desk: orders are queued.
    pub(crate) fn open(&self) {
        self.open.set(true);
    }

    /// Closes the desk: whatever was on the wire is answered 0Bh, whatever waits or comes 0Ah.
    pub(crate) fn close(&self) {
        self.open.set(false);
        self.failed(Exception::GATEWAY_NO_RESPONSE);
        while let Some((frame, event)) = self.queue.borrow_mut().take_if(|_, _| Some(Event::NoPath)) {
            self.fail(frame, event, Exception::GATEWAY_NO_PATH);
        }
        while let Some(frame) = self.place.queue.try_receive(self.gateway.pool()) {
            self.fail(frame, Event::NoPath, Exception::GATEWAY_NO_PATH);
        }
    }

    fn gate(&self, unit: u8) -> Gate {
        self.place.units(|units| units.gate(unit, Instant::now()))
    }

    fn fail(&self, frame: Frame<'g>, event: Event, exception: Exception) {
        self.place.stats.count(event);
        log_debug!("port {}: {} for unit {}", self.id.0, event.name(), frame.envelope().target);
        self.gateway.refuse(frame, exception);
    }
}

fn ticket(envelope: &Envelope) -> Ticket {
    let origin = envelope.origin;
    // A port has seats or a line, not both.
    let seat = if let Way::Seat(seat) = origin.way { seat } else { 0 };
    Ticket {
        asker: Asker { address: envelope.peer, connection: u32::from(origin.port.0) << 16 | u32::from(seat) },
        priority: envelope.priority,
        unit: envelope.target,
        deadline: envelope.deadline,
    }
}
