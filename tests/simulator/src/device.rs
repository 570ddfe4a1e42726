//! Modbus RTU and ASCII devices, written from the specification and not from the gateway's codecs.
//!
//! A device hears whole frames: in RTU it wants t3.5 of silence behind a frame and drops one that has a silence over t1.5
//! inside; a wrong check it drops in any case. It responds after its turnaround time. Its [`Faults`] then decide what the response looks like on the
//! wire. It has one transmitter: responses leave whole and in the order of the requests, so that a late one delays those behind it.
//! [`serve`] lets several devices share one connection to the bus, which costs less than one each.

use std::cell::{RefCell, RefMut};
use std::rc::Rc;

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant};
use embedded_io_async::Write;
use mobgate::settings::Framing;

use crate::fault::{Fault, Faults, Sent, Transmission};
use crate::framing::{self, Listener};
use crate::timing::{chars_ns, t3_5_ns};
use crate::wire::{Heard, LineEnd};

pub mod ascii;
mod fresh;
mod memory;
mod outbox;
pub mod rtu;
pub mod tcp;
#[cfg(test)]
mod tests;

pub use fresh::Fresh;
pub use memory::{Memory, TABLE_LENGTH};
use outbox::Outbox;

/// A device. Clones are the same device.
#[derive(Clone)]
pub struct Device(Rc<RefCell<State>>);

struct State {
    unit: u8,
    turnaround: Duration,
    /// What comes so soon behind its own response it does not hear.
    rest: Duration,
    deaf_until: Instant,
    memory: Memory,
    faults: Faults,
    /// What is answered instead of what the memory says.
    script: Option<Vec<u8>>,
    counters: Counters,
    /// What it was asked, if that is noted.
    requests: Option<Vec<Vec<u8>>>,
    writes: Vec<Executed>,
    /// When its transmitter is free for the next response.
    free: Instant,
    /// When the hiccup ends that keeps it from answering.
    stalled_until: Instant,
    watchdog: Option<Watchdog>,
}

/// What a device does that is not written for some time: its holding registers are 0, until it is written again.
struct Watchdog {
    after: Duration,
    /// When it was written last; it does not watch before.
    written: Option<Instant>,
    trips: u64,
}

/// What a device has counted since the start.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Counters {
    /// Requests executed or refused by an exception, per function code.
    pub requests: [u64; 128],
    /// Frames for anybody with a wrong CRC, or too short or too long to have one.
    pub bad_crc: u64,
    /// Frames with a silence over t1.5 inside.
    pub gap_inside: u64,
}

impl Counters {
    /// Requests of all functions.
    pub fn all_requests(&self) -> u64 {
        self.requests.iter().sum()
    }
}

/// A request that changed the device's memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Executed {
    /// When it was executed.
    pub at: Instant,
    /// Whether it came to everybody, by unit id 0.
    pub broadcast: bool,
    /// The request.
    pub pdu: Vec<u8>,
}

impl Device {
    /// A device with id `unit`, [`Memory::new`]'s values, 1 ms of turnaround time, and no faults.
    pub fn new(unit: u8) -> Self {
        Self(Rc::new(RefCell::new(State {
            unit,
            turnaround: Duration::from_millis(1),
            rest: Duration::from_ticks(0),
            deaf_until: Instant::MIN,
            memory: Memory::new(unit),
            faults: Faults::none(),
            script: None,
            counters: Counters { requests: [0; 128], bad_crc: 0, gap_inside: 0 },
            requests: None,
            writes: Vec::new(),
            free: Instant::MIN,
            stalled_until: Instant::MIN,
            watchdog: None,
        })))
    }

    /// The device with another time between the end of the request's silence and its response.
    #[must_use]
    pub fn with_turnaround(self, turnaround: Duration) -> Self {
        self.0.borrow_mut().turnaround = turnaround;
        self
    }

    /// The device with a pause that it needs behind its own response: requests that begin earlier it does not hear.
    #[must_use]
    pub fn with_rest(self, rest: Duration) -> Self {
        self.0.borrow_mut().rest = rest;
        self
    }

    /// The device with `faults`.
    #[must_use]
    pub fn with_faults(self, faults: Faults) -> Self {
        self.set_faults(faults);
        self
    }

    /// The device with [`Fresh`] registers at `address`, in the holding and the input table.
    #[must_use]
    pub fn with_fresh(self, address: u16) -> Self {
        self.0.borrow_mut().memory.set_fresh(address);
        self
    }

    /// The device with a watchdog: if it is not written for so long after a write, its holding registers become 0.
    #[must_use]
    pub fn with_watchdog(self, after: Duration) -> Self {
        self.0.borrow_mut().watchdog = Some(Watchdog { after, written: None, trips: 0 });
        self
    }

    /// How often its watchdog has tripped.
    pub fn trips(&self) -> u64 {
        let mut state = self.0.borrow_mut();
        state.watch();
        state.watchdog.as_ref().map_or(0, |watchdog| watchdog.trips)
    }

    /// The device without `address`: reads that touch it, in whichever table, are exception 02.
    #[must_use]
    pub fn with_missing(self, address: u16) -> Self {
        self.0.borrow_mut().memory.set_missing(address);
        self
    }

    /// The device noting what it is asked, for [`Self::take_requests`].
    #[must_use]
    pub fn with_notes(self) -> Self {
        self.0.borrow_mut().requests = Some(Vec::new());
        self
    }

    /// Replaces the faults.
    pub fn set_faults(&self, faults: Faults) {
        self.0.borrow_mut().faults = faults;
    }

    /// Answers every request with this PDU from now on, whatever it asks for.
    pub fn set_response(&self, pdu: &[u8]) {
        self.0.borrow_mut().script = Some(pdu.to_vec());
    }

    /// The unit id.
    pub fn unit(&self) -> u8 {
        self.0.borrow().unit
    }

    /// The memory, to look at or to change from outside; not to be held across an await.
    pub fn memory(&self) -> RefMut<'_, Memory> {
        RefMut::map(self.0.borrow_mut(), |state| &mut state.memory)
    }

    /// The counters as they are now.
    pub fn counters(&self) -> Counters {
        self.0.borrow().counters.clone()
    }

    /// The requests to this device alone since this was asked last, also those that a fault has lost.
    pub fn take_requests(&self) -> Vec<Vec<u8>> {
        self.0.borrow_mut().requests.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// The requests that changed something, oldest first.
    pub fn writes(&self) -> Vec<Executed> {
        self.0.borrow().writes.clone()
    }

    /// The requests that changed something since this was asked last.
    pub fn take_writes(&self) -> Vec<Executed> {
        std::mem::take(&mut self.0.borrow_mut().writes)
    }

    /// How often a fault has hit a response.
    pub fn faults_injected(&self) -> u64 {
        self.0.borrow().faults.injected()
    }

    /// Lives at `line` in RTU, for ever.
    pub async fn run(self, line: LineEnd) {
        serve(line, vec![self]).await;
    }

    /// Takes a frame in; the response, if one is to be sent, goes to `outbox`.
    fn hear(&self, framing: Framing, heard: &Heard, line: &LineEnd, outbox: &mut Outbox) {
        let mut state = self.0.borrow_mut();
        if heard.gap_inside {
            state.counters.gap_inside += 1;
            return;
        }
        let Some((unit, pdu)) = framing::open(framing, &heard.bytes) else {
            state.counters.bad_crc += 1;
            return;
        };
        let broadcast = unit == 0;
        if unit != state.unit && !broadcast {
            return;
        }
        let line = line.line();
        let begun_ns = heard.end_ns.saturating_sub(chars_ns(&line, heard.bytes.len() as u64));
        if begun_ns < state.deaf_until.as_nanos() {
            return;
        }
        if broadcast {
            state.execute(&pdu, true);
            return;
        }
        let frame = |unit, pdu: &[u8], _| framing::frame(framing, unit, pdu);
        let Some(mut transmission) = state.response(framing, &pdu, frame) else { return };
        // Each piece waits until the one before is on the wire.
        let mut before = Duration::from_ticks(0);
        let mut length = before;
        for piece in &mut transmission.pieces {
            piece.pause += before;
            length += piece.pause;
            before = Duration::from_nanos(chars_ns(&line, piece.what.length() as u64));
        }
        let silence = match framing {
            Framing::Rtu => Duration::from_nanos(t3_5_ns(&line)),
            Framing::Ascii => Duration::from_ticks(0),
        };
        let begin = state.begin(transmission.late).max(state.free + silence.max(state.turnaround));
        state.free = begin + length + before;
        if state.rest > Duration::from_ticks(0) {
            state.deaf_until = state.free + state.rest;
        }
        outbox.push(begin, transmission.pieces);
    }

    /// Takes a request in that came by TCP; the response goes to `outbox`, `in_order` behind those that it holds already.
    fn asked(
        &self,
        pdu: &[u8],
        in_order: bool,
        frame: impl Fn(u8, &[u8], bool) -> Vec<u8>,
        outbox: &mut Outbox,
    ) {
        let mut state = self.0.borrow_mut();
        let Some(transmission) = state.response(Framing::Rtu, pdu, frame) else { return };
        let mut begin = state.begin(transmission.late);
        if in_order {
            begin = begin.max(state.free + state.turnaround);
            let pauses = transmission.pieces.iter().map(|piece| piece.pause);
            state.free = pauses.fold(begin, |at, pause| at + pause);
        }
        outbox.push(begin, transmission.pieces);
    }
}

impl State {
    /// What is sent as the response to `pdu`, if anything is.
    fn response(
        &mut self,
        framing: Framing,
        pdu: &[u8],
        frame: impl Fn(u8, &[u8], bool) -> Vec<u8>,
    ) -> Option<Transmission> {
        self.requests.iter_mut().for_each(|requests| requests.push(pdu.to_vec()));
        let hits = self.faults.draw(pdu);
        if hits.contains(&Fault::Unheard) {
            return None;
        }
        let response = self.execute(pdu, false);
        let transmission = self.faults.transmission(framing, self.unit, &hits, response, frame)?;
        // What comes in a hiccup does not prolong it.
        if let (Some(stall), true) = (transmission.hiccup, self.stalled_until <= Instant::now()) {
            self.stalled_until = Instant::now() + stall;
        }
        Some(transmission)
    }

    /// When the response to a request of now begins, if the transmitter is free then.
    fn begin(&self, late: Duration) -> Instant {
        (Instant::now() + late).max(self.stalled_until) + self.turnaround
    }

    /// Trips if it was not written for too long.
    fn watch(&mut self) {
        let Some(watchdog) = &mut self.watchdog else { return };
        if watchdog.written.is_some_and(|written| written + watchdog.after < Instant::now()) {
            (watchdog.written, watchdog.trips) = (None, watchdog.trips + 1);
            self.memory.holding.fill(0);
        }
    }

    fn execute(&mut self, pdu: &[u8], broadcast: bool) -> Vec<u8> {
        self.watch();
        let function = pdu[0];
        self.counters.requests[usize::from(function & 0x7f)] += 1;
        if let Some(response) = &self.script {
            return response.clone();
        }
        match self.memory.execute(pdu) {
            Ok(response) => {
                if matches!(function, 5 | 6 | 15 | 16 | 22 | 23) {
                    self.watchdog.iter_mut().for_each(|watchdog| watchdog.written = Some(Instant::now()));
                    self.writes.push(Executed { at: Instant::now(), broadcast, pdu: pdu.to_vec() });
                }
                response
            }
            Err(exception) => vec![function | 0x80, exception],
        }
    }
}

/// Lets `devices` live at `line` in RTU, for ever. They hear the same frames; a response that is late is sent then,
/// whatever others have on the wire.
pub async fn serve(line: LineEnd, devices: Vec<Device>) {
    serve_in(Framing::Rtu, line, devices).await;
}

/// [`serve`] in either framing.
pub async fn serve_in(framing: Framing, mut line: LineEnd, devices: Vec<Device>) {
    let mut outbox = Outbox::new();
    let mut listener = Listener::new(line.clone(), framing);
    loop {
        match select(listener.hear(), outbox.due()).await {
            Either::First(heard) => {
                devices.iter().for_each(|device| device.hear(framing, &heard, &line, &mut outbox));
            }
            Either::Second(Sent::Bytes(bytes)) => {
                // The bus has nobody to tell: an unplugged device just is not heard.
                let _ = line.write_all(&bytes).await;
            }
            Either::Second(Sent::Flawed(bytes, flaw)) => line.write_flawed(&bytes, flaw),
            // A bus has no connections.
            Either::Second(Sent::Close | Sent::Reset) => {}
        }
    }
}
