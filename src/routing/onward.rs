//! Cut-through decision: the destination of a request that is still arriving at a serial line, based on its beginning.

use crate::modbus::pdu::addresses_end;
use crate::modbus::pdu::function::ENCAPSULATED_INTERFACE;
use crate::routing::{Client, meaning, rule};
use crate::settings::{
    Cut, Destination, Driver, Lane, Policy, PortId, PortKind, SerialSettings, Settings, Special,
};

/// How to handle a request that is still arriving.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Onward {
    /// Forward it once it is complete, if at all.
    Whole,
    /// More of it is needed to decide.
    Later,
    /// It may be cut through to this line.
    To(Lane),
}

/// Decides for a request for `unit` arriving at `source`, with `so_far` received after the unit. `auto`: whether the board's
/// transmitters never underrun.
pub fn onward(settings: &Settings, source: PortId, unit: u8, so_far: &[u8], auto: bool) -> Onward {
    let unit = match meaning(settings, source, unit) {
        Special::Rules => unit,
        Special::Replace(unit) => unit,
        Special::Off | Special::Local | Special::AllLines => return Onward::Whole,
    };
    let Some(rule) = rule(settings, source, unit, Client::at(None)) else { return Onward::Whole };
    let line = |port| settings.port(port).and_then(|port| passing_line(&port.kind));
    let Destination::Port(destination) = rule.destination else { return Onward::Whole };
    let lines = line(source).and(line(destination));
    let allowed = match rule.policy.cut {
        Cut::Auto => auto,
        Cut::On => true,
        Cut::Off => false,
    };
    // A broadcast must be checked when complete.
    let to_one = rule.tag.apply(unit).is_some_and(|unit| unit != 0);
    match (lines, needed(&rule.policy, so_far)) {
        (Some(line), Some(needed)) if allowed && to_one => {
            if so_far.len() < needed {
                return Onward::Later;
            }
            // A refusal needs the complete request.
            if rule.policy.admit(so_far).is_ok() { Onward::To(line) } else { Onward::Whole }
        }
        _ => Onward::Whole,
    }
}

/// The settings of a line that can send frames while they arrive. A line with an echo, or whose driver is switched by the
/// gateway, needs complete frames.
fn passing_line(kind: &PortKind) -> Option<Lane> {
    match kind {
        PortKind::Serial(serial @ SerialSettings { line, .. })
            if !line.echo && line.driver != Driver::Rts =>
        {
            Some(Lane::of(serial))
        }
        _ => None,
    }
}

/// Number of PDU bytes that `policy` needs to decide; `None` if it needs all.
fn needed(policy: &Policy, so_far: &[u8]) -> Option<usize> {
    match so_far.first() {
        _ if policy.looks_at_nothing() => Some(0),
        None => Some(1),
        // The MEI type.
        Some(&ENCAPSULATED_INTERFACE) => Some(2),
        Some(_) if !policy.looks_at_addresses() => Some(1),
        Some(_) => addresses_end(so_far),
    }
}
