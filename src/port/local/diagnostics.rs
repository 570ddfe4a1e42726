//! Diagnostics (FC 08) and the communication event functions (0B, 0C), Application Protocol 6.8 to 6.10.
//!
//! The counters are those of the port that the request came by, on 16 bits. So is the listen-only mode: the own unit falls silent
//! for whoever asks by that port, and goes on for all others. A restart of communications ends that and clears the counters; the
//! port itself stays open, for the sake of the units behind the gateway.

use embassy_time::Instant;
use heapless::Deque;

use super::{Answered, put};
use crate::config::{PORTS_MAX, PortId};
use crate::gateway::{Gateway, PortAt, PortPlace, Status};
use crate::modbus::Exception;
use crate::modbus::Pdu;
use crate::modbus::pdu::function::{DIAGNOSTICS, GET_COMM_EVENT_COUNTER, GET_COMM_EVENT_LOG};
use crate::port::units::Unit;
use crate::stats::{Counters, Event};

/// Bytes of the event log (6.10).
const LOG_BYTES_MAX: usize = 64;
/// A message was received, and came to everybody (6.10).
const RECEIVED: u8 = 0x80;
const BROADCAST: u8 = 0x40;
/// An answer was sent; an exception 1 to 3, 4, 5 or 6, or 7.
const SENT: u8 = 0x40;
const READ_EXCEPTION: u8 = 0x01;
const ABORT_EXCEPTION: u8 = 0x02;
const BUSY_EXCEPTION: u8 = 0x04;
const NAK_EXCEPTION: u8 = 0x08;
/// The own unit only listened when a message was received, has begun to, or has restarted communications.
const LISTENED: u8 = 0x20;
const BEGAN_TO_LISTEN: u8 = 0x04;
const RESTARTED: u8 = 0x00;
/// Bits of the diagnostic register: a port is lost or cannot be opened; a unit is down; no frame is free.
const PORT_FAILED: u16 = 1;
const UNIT_DOWN: u16 = 2;
const NO_FRAME: u16 = 4;

/// Answers sub-function `sub` with `data`, which came by `port`.
pub(super) fn answer(
    gateway: &Gateway<'_>,
    port: PortId,
    sub: u16,
    data: &[u8],
    answer: &mut Pdu,
) -> Answered {
    let place = gateway.ports().get(port.index()).ok_or(Exception::DEVICE_FAILURE)?;
    let header = [DIAGNOSTICS, (sub >> 8) as u8, sub as u8];
    // Return query data: the answer repeats the request.
    if sub == 0 {
        return put(answer, &[&header, data]);
    }
    let counter = match sub {
        // Return the diagnostic register.
        2 if data == [0, 0] => register(gateway),
        0x02 => return Err(Exception::ILLEGAL_VALUE),
        0x0a | 0x14 | 0x0b..=0x12 if data != [0, 0] => return Err(Exception::ILLEGAL_VALUE),
        // Clear counters.
        0x0a => {
            place.stats.clear(Instant::now());
            gateway.events(|events| events.completed = 0);
            0
        }
        // Clear the overrun counter.
        0x14 => {
            place.stats.reset(Event::Overrun);
            0
        }
        sub => counter(&place.stats, sub).ok_or(Exception::ILLEGAL_FUNCTION)?,
    };
    put(answer, &[&header, &counter.to_be_bytes()])
}

/// The state of all ports, as it is now: there is nothing to clear.
fn register(gateway: &Gateway<'_>) -> u16 {
    let failed = |place: &PortPlace| matches!(place.status(), Status::Lost | Status::Failed(_));
    let down = |port: PortAt<'_>| port.units(|units| units.iter().any(Unit::is_down));
    let bit = |is, bit| if is { bit } else { 0 };
    bit(gateway.ports().iter().any(failed), PORT_FAILED)
        | bit(gateway.places().any(down), UNIT_DOWN)
        | bit(gateway.pool().free() == 0, NO_FRAME)
}

/// What becomes of a message to the own unit before anything else: whether it listens only at `port`, or is told to, or no longer.
pub(super) fn mode(gateway: &Gateway<'_>, port: PortId, request: &[u8]) -> Mode {
    let bit = 1 << port.index();
    let listens = gateway.events(|events| events.listens & bit != 0);
    match *request {
        // Restart communications; FF00 clears the event log, too.
        [DIAGNOSTICS, 0, 1, clear @ (0 | 0xff), 0] => {
            if let Some(place) = gateway.ports().get(port.index()) {
                place.stats.clear(Instant::now());
            }
            gateway.events(|events| {
                events.listens &= !bit;
                events.completed = 0;
                if clear != 0 {
                    events.log.clear();
                }
                events.push(RESTARTED);
            });
            if listens { Mode::Silent } else { Mode::Restarted }
        }
        // Force listen-only mode, which has no answer.
        [DIAGNOSTICS, 0, 4, 0, 0] if !listens => {
            gateway.events(|events| {
                events.listens |= bit;
                events.push(RECEIVED);
                events.push(BEGAN_TO_LISTEN);
            });
            Mode::Silent
        }
        _ if listens => {
            gateway.events(|events| events.push(RECEIVED | LISTENED));
            Mode::Silent
        }
        [DIAGNOSTICS, 0, 1 | 4, ..] => Mode::Refused,
        _ => Mode::Answers,
    }
}

/// What the own unit does with a message.
pub(super) enum Mode {
    /// It answers.
    Answers,
    /// It has restarted communications, and says so by giving the request back.
    Restarted,
    /// A value that the sub-function has not.
    Refused,
    /// Nothing.
    Silent,
}

/// The counter that sub-function `sub` returns.
fn counter(stats: &Counters, sub: u16) -> Option<u16> {
    let all = match sub {
        0x0b => bus_messages(stats),
        0x0c => stats.get(Event::Damaged),
        0x0d => stats.get(Event::Exception),
        0x0e => stats.get(Event::Request),
        // The answer to this request is still to come.
        0x0f => stats.get(Event::Request).wrapping_sub(stats.get(Event::Answer)).saturating_sub(1),
        // Negative acknowledgement is for programming functions, which the gateway has not.
        0x10 => 0,
        0x11 => stats.get(Event::Busy),
        0x12 => stats.get(Event::Overrun),
        _ => return None,
    };
    Some(all as u16)
}

/// Good messages at the port, for whomever.
fn bus_messages(stats: &Counters) -> u32 {
    stats.get(Event::Request).wrapping_add(stats.get(Event::Foreign))
}

/// Sub-function 0Bh's counter of `port`.
pub(super) fn messages(gateway: &Gateway<'_>, port: PortId) -> u16 {
    gateway.ports().get(port.index()).map_or(0, |place| bus_messages(&place.stats) as u16)
}

/// What the own unit has done last.
pub(crate) struct Events {
    /// Messages that were carried out, other than those that ask for this number.
    completed: u16,
    /// Newest last.
    log: Deque<u8, LOG_BYTES_MAX>,
    /// The ports by which the own unit only listens, a bit each.
    listens: u16,
}

const _: () = assert!(PORTS_MAX <= u16::BITS as usize, "a bit for each port");

impl Events {
    pub(crate) const fn new() -> Self {
        Self { completed: 0, log: Deque::new(), listens: 0 }
    }

    /// Notes a message to the own unit and its answer.
    pub(super) fn note(&mut self, request: &[u8], broadcast: bool, answer: Answered) {
        let fetches = matches!(request, [GET_COMM_EVENT_COUNTER | GET_COMM_EVENT_LOG, ..]);
        if answer.is_ok() && !fetches {
            self.completed = self.completed.wrapping_add(1);
        }
        self.push(RECEIVED | if broadcast { BROADCAST } else { 0 });
        let exception = match answer {
            Ok(()) => 0,
            Err(Exception(1..=3)) => READ_EXCEPTION,
            Err(Exception(4)) => ABORT_EXCEPTION,
            Err(Exception(7)) => NAK_EXCEPTION,
            Err(_) => BUSY_EXCEPTION,
        };
        self.push(SENT | exception);
    }

    fn push(&mut self, event: u8) {
        if self.log.is_full() {
            self.log.pop_front();
        }
        // There is room now.
        let _ = self.log.push_back(event);
    }

    /// Status word (no program runs) and event count.
    pub(super) fn counter(&self) -> [u8; 4] {
        let [high, low] = self.completed.to_be_bytes();
        [0, 0, high, low]
    }

    /// The answer to FC 0Ch: the newest event first.
    pub(super) fn log(&self, messages: u16, answer: &mut Pdu) -> Answered {
        let header = [GET_COMM_EVENT_LOG, 6 + self.log.len() as u8];
        put(answer, &[&header, &self.counter(), &messages.to_be_bytes()])?;
        self.log.iter().rev().try_for_each(|event| put(answer, &[&[*event]]))
    }
}
