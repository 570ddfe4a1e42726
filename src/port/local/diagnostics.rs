//! Diagnostics (FC 08) and the communication event functions (0B, 0C), Application Protocol 6.8 to 6.10.
//!
//! The counters are those of the port that the request came by, truncated to 16 bits. Listen-only mode is per port too: the own
//! unit is silent for clients of that port only. Restarting communications ends listen-only mode and clears the counters; the port
//! itself stays open for the units behind the gateway.

use embassy_time::Instant;

use super::response::{Answered, put};
use crate::gateway::events::Events;
use crate::gateway::unit_health::Unit;
use crate::gateway::{Gateway, PortAt, PortState, Status};
use crate::modbus::pdu::function::{DIAGNOSTICS, GET_COMM_EVENT_LOG};
use crate::modbus::{Exception, Pdu};
use crate::settings::PortId;
use crate::stats::{Counters, Event};

/// Bits of the diagnostic register: a port has failed; a unit is down; no frame is free.
const PORT_FAILED: u16 = 1;
const UNIT_DOWN: u16 = 2;
const NO_FRAME: u16 = 4;

/// Responds to sub-function `sub` with `data`, received by `port`.
pub(super) fn respond(
    gateway: &Gateway<'_>,
    port: PortId,
    sub: u16,
    data: &[u8],
    response: &mut Pdu,
) -> Answered {
    let port_state = gateway.ports().get(port.index()).ok_or(Exception::DEVICE_FAILURE)?;
    let header = [DIAGNOSTICS, (sub >> 8) as u8, sub as u8];
    // Return query data: the response repeats the request.
    if sub == 0 {
        return put(response, &[&header, data]);
    }
    let counter = match sub {
        // Return the diagnostic register.
        2 if data == [0, 0] => register(gateway),
        0x02 => return Err(Exception::ILLEGAL_VALUE),
        0x0a | 0x14 | 0x0b..=0x12 if data != [0, 0] => return Err(Exception::ILLEGAL_VALUE),
        // Clear counters.
        0x0a => {
            port_state.stats.clear(Instant::now());
            gateway.events(Events::clear_count);
            0
        }
        // Clear the overrun counter.
        0x14 => {
            port_state.stats.reset(Event::Overrun);
            0
        }
        sub => counter(&port_state.stats, sub).ok_or(Exception::ILLEGAL_FUNCTION)?,
    };
    put(response, &[&header, &counter.to_be_bytes()])
}

/// The current state of all ports; there is nothing to clear.
fn register(gateway: &Gateway<'_>) -> u16 {
    let failed = |port_state: &PortState| {
        matches!(port_state.status(), Status::Waiting | Status::Lost | Status::Failed(_))
    };
    let down = |port: PortAt<'_>| port.units(|units| units.iter().any(Unit::is_down));
    let bit = |is, bit| if is { bit } else { 0 };
    bit(gateway.ports().iter().any(failed), PORT_FAILED)
        | bit(gateway.port_states().any(down), UNIT_DOWN)
        | bit(gateway.pool().free() == 0, NO_FRAME)
}

/// Handles listen-only mode, ahead of everything else: whether the own unit is silent at `port`, and requests that change that.
pub(super) fn mode(gateway: &Gateway<'_>, port: PortId, request: &[u8]) -> Mode {
    let listens = gateway.events(|events| events.listens_only(port));
    match *request {
        // Restart communications; FF00 clears the event log, too.
        [DIAGNOSTICS, 0, 1, clear @ (0 | 0xff), 0] => {
            if let Some(port_state) = gateway.ports().get(port.index()) {
                port_state.stats.clear(Instant::now());
            }
            gateway.events(|events| events.restart(port, clear != 0));
            if listens { Mode::Silent } else { Mode::Restarted }
        }
        // Force listen-only mode, which has no response.
        [DIAGNOSTICS, 0, 4, 0, 0] if !listens => {
            gateway.events(|events| events.listen_only(port));
            Mode::Silent
        }
        _ if listens => {
            gateway.events(Events::listened);
            Mode::Silent
        }
        [DIAGNOSTICS, 0, 1 | 4, ..] => Mode::Refused,
        _ => Mode::Responds,
    }
}

/// How the own unit reacts to a request.
pub(super) enum Mode {
    /// It responds.
    Responds,
    /// It has restarted communications; the response repeats the request.
    Restarted,
    /// The sub-function does not allow that value.
    Refused,
    /// It stays silent.
    Silent,
}

/// The counter that sub-function `sub` returns.
fn counter(stats: &Counters, sub: u16) -> Option<u16> {
    let all = match sub {
        0x0b => bus_messages(stats),
        0x0c => stats.get(Event::Corrupt),
        0x0d => stats.get(Event::Exception),
        0x0e => stats.get(Event::Request),
        // The response to this request is still to come.
        0x0f => stats.get(Event::Request).wrapping_sub(stats.get(Event::Response)).saturating_sub(1),
        // NAK is for programming functions, which the gateway does not support.
        0x10 => 0,
        0x11 => stats.get(Event::Busy),
        0x12 => stats.get(Event::Overrun),
        _ => return None,
    };
    Some(all as u16)
}

/// Valid messages at the port, for any unit.
fn bus_messages(stats: &Counters) -> u32 {
    stats.get(Event::Request).wrapping_add(stats.get(Event::Foreign))
}

/// The counter of sub-function 0Bh at `port`.
pub(super) fn messages(gateway: &Gateway<'_>, port: PortId) -> u16 {
    gateway.ports().get(port.index()).map_or(0, |port_state| bus_messages(&port_state.stats) as u16)
}

/// The response to FC 0Ch: status word, event counter, `messages` of the port, and events from the newest on.
pub(super) fn event_log(events: &Events, messages: u16, response: &mut Pdu) -> Answered {
    let header = [GET_COMM_EVENT_LOG, 6 + events.len() as u8];
    put(response, &[&header, &events.counter(), &messages.to_be_bytes()])?;
    events.newest_first().try_for_each(|event| put(response, &[&[event]]))
}
