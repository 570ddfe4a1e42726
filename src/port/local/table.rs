//! The gateway's state as input registers of its own unit. The table is in docs/registers.md; its addresses are stable.
//!
//! From [`BASE`] on: one block for the gateway, one per port, and one per known unit of each port. 32-bit numbers have the high
//! word first. Unused registers read as zero.

use embassy_time::Instant;

use super::{Answered, image, points, put};
use crate::gateway::unit_health::{LINE_ERRORS, State, UNITS_MAX, Unit};
use crate::gateway::{Gateway, PortAt, Status};
use crate::modbus::pdu::function::{READ_HOLDING_REGISTERS, READ_INPUT_REGISTERS};
use crate::modbus::{Exception, Pdu};
use crate::settings::{PORTS_MAX, PortId};
use crate::stats::Event;

/// The first register of the gateway's block.
pub const BASE: u16 = 0x8000;
/// The first register of port 0's block, and the length of a block.
pub const PORTS: u16 = 0x8100;
/// See [`PORTS`].
pub const PORT_LENGTH: u16 = 0x40;
/// The first register of the first unit of port 0, and the length of a unit's block; each port has [`UNITS_PER_PORT`] of them.
pub const UNITS: u16 = 0x9000;
/// See [`UNITS`].
pub const UNIT_LENGTH: u16 = 0x20;

/// Units per port in this table; fixed, since it determines addresses.
pub const UNITS_PER_PORT: usize = if UNITS_MAX < 32 { UNITS_MAX } else { 32 };

/// The version of this table.
const VERSION: u16 = 1;
const PORTS_END: u16 = PORTS + PORTS_MAX as u16 * PORT_LENGTH;
const UNITS_END: u16 = UNITS + (PORTS_MAX * UNITS_PER_PORT) as u16 * UNIT_LENGTH;
/// Most registers in one response (Application Protocol 6.4).
const REGISTERS_MAX: u16 = 125;

/// The counters in a port's block, two registers each, from register 4 on.
pub const COUNTERS: [Event; 28] = [
    Event::Request,
    Event::Response,
    Event::Exception,
    Event::Timeout,
    Event::Silent,
    Event::Corrupt,
    Event::BadCheck,
    Event::Short,
    Event::Parity,
    Event::Framing,
    Event::Overrun,
    Event::WrongUnit,
    Event::Misfit,
    Event::Late,
    Event::Echo,
    Event::Noise,
    Event::Retry,
    Event::UnitDown,
    Event::Expired,
    Event::RequesterGone,
    Event::QueueFull,
    Event::Refused,
    Event::NoPath,
    Event::BackPressure,
    Event::Busy,
    Event::Foreign,
    Event::LineLost,
    Event::Collision,
];

/// Responds to `request`, if it reads this table or operates points.
pub(super) fn respond(gateway: &Gateway<'_>, request: &[u8], response: &mut Pdu) -> Option<Answered> {
    let &[function @ (READ_INPUT_REGISTERS | READ_HOLDING_REGISTERS), a, b, c, d] = request else {
        // The response repeats address and value or quantity (clauses 6.6, 6.12).
        let written = points::write(gateway, request)?;
        return Some(written.and_then(|()| put(response, &[request.get(..5).unwrap_or_default()])));
    };
    let (first, count) = (u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d]));
    let is_input = function == READ_INPUT_REGISTERS;
    if first < if is_input { BASE } else { points::POINTS } || !is_input && gateway.scanner().is_none() {
        return None;
    }
    let register = if is_input { register } else { points::holding };
    if !(1..=REGISTERS_MAX).contains(&count) {
        return Some(Err(Exception::ILLEGAL_VALUE));
    }
    // Sized for that many registers.
    let _ = put(response, &[&[function, 2 * count as u8]]);
    for offset in 0..count {
        let value = first.checked_add(offset).and_then(|address| register(gateway, address));
        let Some(value) = value else { return Some(Err(Exception::ILLEGAL_ADDRESS)) };
        let _ = put(response, &[&value.to_be_bytes()]);
    }
    Some(Ok(()))
}

/// The register at `address`, if there is one.
fn register(gateway: &Gateway<'_>, address: u16) -> Option<u16> {
    match address {
        BASE..PORTS => Some(of_gateway(gateway, address - BASE)),
        PORTS..PORTS_END => {
            let port_state = gateway.port_state(PortId(((address - PORTS) / PORT_LENGTH) as u8));
            Some(port_state.map_or(0, |port_state| of_port(&port_state, (address - PORTS) % PORT_LENGTH)))
        }
        UNITS..UNITS_END => {
            let (block, at) = (usize::from((address - UNITS) / UNIT_LENGTH), (address - UNITS) % UNIT_LENGTH);
            let port_state = gateway.port_state(PortId((block / UNITS_PER_PORT) as u8));
            let unit = port_state.and_then(|port_state| {
                port_state.units(|units| {
                    let unit = *units.iter().nth(block % UNITS_PER_PORT)?;
                    Some((unit, units.state(&unit, Instant::now())))
                })
            });
            Some(unit.map_or(0, |(unit, state)| of_unit(&unit, state, at)))
        }
        points::POINTS.. => points::input(gateway, address),
        _ => image::register(gateway.ethercat()?, address),
    }
}

fn of_gateway(gateway: &Gateway<'_>, at: u16) -> u16 {
    let uptime = Instant::now().as_secs() as u32;
    match at {
        0 => VERSION,
        1 => gateway.ports().len() as u16,
        2 => UNITS_PER_PORT as u16,
        3 => gateway.pool().capacity() as u16,
        4 => gateway.pool().free() as u16,
        5 => {
            gateway.connections().iter().filter(|connection| connection.state().peer.is_some()).count() as u16
        }
        6 | 7 => half(uptime, at - 6),
        _ => 0,
    }
}

fn of_port(port_state: &PortAt<'_>, at: u16) -> u16 {
    match at {
        0 => match port_state.status() {
            Status::Off => 0,
            Status::Open => 1,
            Status::Idle => 2,
            Status::Lost => 3,
            Status::Failed(_) => 4,
            Status::Waiting => 5,
        },
        1 => port_state.stats.last_error() as u16,
        2 => port_state.waiting(),
        3 => port_state.units(|units| units.iter().count()) as u16,
        at => {
            let counter = COUNTERS.get(usize::from((at - 4) / 2));
            counter.map_or(0, |event| half(port_state.stats.get(*event), at % 2))
        }
    }
}

fn of_unit(unit: &Unit, state: State, at: u16) -> u16 {
    let percentile = |percent| unit.times.percentile(percent).unwrap_or(0);
    let wide = [
        unit.requests,
        unit.responses,
        unit.exceptions,
        unit.timeouts,
        unit.took_us,
        percentile(50),
        percentile(99),
    ];
    match usize::from(at) {
        0 => unit.id.into(),
        1 => match state {
            State::Up => 0,
            State::Held => 1,
            State::Down => 2,
            State::OutOfStep => 3,
        },
        at @ 2..16 => wide.get(at / 2 - 1).map_or(0, |value| half(*value, at as u16 % 2)),
        at => LINE_ERRORS.get(at - 16).map_or(0, |error| unit.error(*error)),
    }
}

/// The high (0) or low (1) half of `value`.
fn half(value: u32, which: u16) -> u16 {
    if which == 0 { (value >> 16) as u16 } else { value as u16 }
}
