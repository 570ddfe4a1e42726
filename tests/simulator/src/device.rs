//! Modbus RTU and ASCII devices, written from the specification and not from the gateway's codecs.
//!
//! A device hears whole frames: in RTU it wants t3.5 of silence behind a frame and drops one that has a silence over t1.5
//! inside; a wrong check it drops in any case. It answers after its turnaround time. Its [`Faults`] then decide what the answer looks like on the
//! wire. [`serve`] lets several devices share one connection to the bus, which costs less than one each.

use std::cell::{RefCell, RefMut};
use std::rc::Rc;

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::Write;
use mobgate::config::Framing;

use crate::fault::{Faults, Sent};
use crate::framing::{self, Listener};
use crate::wire::{Heard, LineEnd};

pub mod ascii;
mod fresh;
mod memory;
pub mod rtu;
pub mod tcp;
#[cfg(test)]
mod tests;

pub use fresh::Fresh;
pub use memory::{Memory, TABLE_LENGTH};

/// A device. Clones are the same device.
#[derive(Clone)]
pub struct Device(Rc<RefCell<State>>);

struct State {
    unit: u8,
    turnaround: Duration,
    /// What comes so soon behind its own answer it does not hear.
    rest: Duration,
    deaf_until: Instant,
    memory: Memory,
    faults: Faults,
    /// What is answered instead of what the memory says.
    script: Option<Vec<u8>>,
    counters: Counters,
    writes: Vec<Executed>,
    /// When its transmitter is free for the next answer.
    free: Instant,
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
            writes: Vec::new(),
            free: Instant::MIN,
        })))
    }

    /// The device with another time between the end of the request's silence and its answer.
    #[must_use]
    pub fn with_turnaround(self, turnaround: Duration) -> Self {
        self.0.borrow_mut().turnaround = turnaround;
        self
    }

    /// The device with a pause that it needs behind its own answer: requests that begin earlier it does not hear.
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

    /// The device without `address`: reads that touch it, in whichever table, are exception 02.
    #[must_use]
    pub fn with_missing(self, address: u16) -> Self {
        self.0.borrow_mut().memory.set_missing(address);
        self
    }

    /// Replaces the faults.
    pub fn set_faults(&self, faults: Faults) {
        self.0.borrow_mut().faults = faults;
    }

    /// Answers every request with this PDU from now on, whatever it asks for.
    pub fn set_answer(&self, pdu: &[u8]) {
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

    /// The requests that changed something, oldest first.
    pub fn writes(&self) -> Vec<Executed> {
        self.0.borrow().writes.clone()
    }

    /// The requests that changed something since this was asked last.
    pub fn take_writes(&self) -> Vec<Executed> {
        std::mem::take(&mut self.0.borrow_mut().writes)
    }

    /// How often a fault has hit an answer.
    pub fn faults_injected(&self) -> u64 {
        self.0.borrow().faults.injected()
    }

    /// Lives at `line` in RTU, for ever.
    pub async fn run(self, line: LineEnd) {
        serve(line, vec![self]).await;
    }

    /// Takes a frame in; the pieces of the answer, if one is to be sent, go to `outbox`.
    fn hear(&self, framing: Framing, heard: &Heard, line: &LineEnd, outbox: &mut Vec<Outgoing>) {
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
        let begun_ns = heard.end_ns.saturating_sub(line.line().chars(heard.bytes.len()).as_nanos());
        if begun_ns < state.deaf_until.as_nanos() {
            return;
        }
        let answer = state.execute(&pdu, broadcast);
        if broadcast {
            return;
        }
        let State { unit, turnaround, ref mut faults, free, .. } = *state;
        // A device has one transmitter: what it still has to say goes first.
        let mut at = (Instant::now() + turnaround).max(free);
        let frame = |unit, pdu: &[u8], _| framing::frame(framing, unit, pdu);
        for piece in faults.transmission(framing, unit, &pdu, answer, frame) {
            at += piece.pause;
            let length = match &piece.what {
                Sent::Bytes(bytes) | Sent::Flawed(bytes, _) => bytes.len(),
                Sent::Close | Sent::Reset => 0,
            };
            outbox.push(Outgoing { at, what: piece.what });
            at += line.line().chars(length);
        }
        state.free = at;
        if state.rest > Duration::from_ticks(0) {
            state.deaf_until = at + state.rest;
        }
    }

    /// Takes a request in that came by TCP; the pieces of the answer go to `outbox`.
    fn asked(&self, pdu: &[u8], frame: impl Fn(u8, &[u8], bool) -> Vec<u8>, outbox: &mut Vec<Outgoing>) {
        let mut state = self.0.borrow_mut();
        let answer = state.execute(pdu, false);
        let State { unit, turnaround, ref mut faults, .. } = *state;
        let mut at = Instant::now() + turnaround;
        for piece in faults.transmission(Framing::Rtu, unit, pdu, answer, frame) {
            at += piece.pause;
            outbox.push(Outgoing { at, what: piece.what });
        }
    }
}

impl State {
    fn execute(&mut self, pdu: &[u8], broadcast: bool) -> Vec<u8> {
        let function = pdu[0];
        self.counters.requests[usize::from(function & 0x7f)] += 1;
        if let Some(answer) = &self.script {
            return answer.clone();
        }
        match self.memory.execute(pdu) {
            Ok(answer) => {
                if matches!(function, 5 | 6 | 15 | 16 | 22 | 23) {
                    self.writes.push(Executed { at: Instant::now(), broadcast, pdu: pdu.to_vec() });
                }
                answer
            }
            Err(exception) => vec![function | 0x80, exception],
        }
    }
}

/// Bytes that are due to be sent.
struct Outgoing {
    at: Instant,
    what: Sent,
}

/// Waits until something is due, and takes it out.
async fn due(outbox: &mut Vec<Outgoing>) -> Sent {
    let first = outbox.iter().enumerate().min_by_key(|(_, outgoing)| outgoing.at);
    match first.map(|(index, outgoing)| (index, outgoing.at)) {
        Some((index, at)) => {
            Timer::at(at).await;
            outbox.remove(index).what
        }
        None => std::future::pending().await,
    }
}

/// Lets `devices` live at `line` in RTU, for ever. They hear the same frames; an answer that is late is sent then,
/// whatever else is on the wire.
pub async fn serve(line: LineEnd, devices: Vec<Device>) {
    serve_in(Framing::Rtu, line, devices).await;
}

/// [`serve`] in either framing.
pub async fn serve_in(framing: Framing, mut line: LineEnd, devices: Vec<Device>) {
    let mut outbox: Vec<Outgoing> = Vec::new();
    let mut listener = Listener::new(line.clone(), framing);
    loop {
        match select(listener.hear(), due(&mut outbox)).await {
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
