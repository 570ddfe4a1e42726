//! Where a request that is still arriving at a serial line may be passed on to, as far as its beginning tells.

use crate::modbus::pdu::addresses_end;
use crate::modbus::pdu::function::ENCAPSULATED_INTERFACE;
use crate::routing::{meaning, rule};
use crate::settings::{
    Cut, Destination, Driver, Lane, Policy, PortId, PortKind, SerialSettings, Settings, Special,
};

/// What becomes of a request that is arriving.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Onward {
    /// It is passed on when it is whole, if at all.
    Whole,
    /// The rule has to see more of it.
    Later,
    /// It may be passed on to this line.
    To(Lane),
}

/// What becomes of the request for `unit` that is arriving at `source`, of which `so_far` is there behind the unit.
/// `auto`: whether the board's transmitters cannot underrun.
pub fn onward(settings: &Settings, source: PortId, unit: u8, so_far: &[u8], auto: bool) -> Onward {
    let unit = match meaning(settings, source, unit) {
        Special::Rules => unit,
        Special::Replace(unit) => unit,
        Special::Off | Special::Local | Special::AllLines => return Onward::Whole,
    };
    let Some(rule) = rule(settings, source, unit, None) else { return Onward::Whole };
    let line = |port| settings.port(port).and_then(|port| passing_line(&port.kind));
    let Destination::Port(destination) = rule.destination else { return Onward::Whole };
    let lines = line(source).and(line(destination));
    let allowed = match rule.policy.cut {
        Cut::Auto => auto,
        Cut::On => true,
        Cut::Off => false,
    };
    // What goes to everybody is checked first.
    let to_one = rule.tag.apply(unit).is_some_and(|unit| unit != 0);
    match (lines, needed(&rule.policy, so_far)) {
        (Some(line), Some(needed)) if allowed && to_one => {
            if so_far.len() < needed {
                return Onward::Later;
            }
            // What is refused is refused when it is whole.
            if rule.policy.admit(so_far).is_ok() { Onward::To(line) } else { Onward::Whole }
        }
        _ => Onward::Whole,
    }
}

/// The settings of a line on which frames may be passed on while they arrive: an adapter that hears itself, or whose driver
/// is switched by the gateway, wants whole frames.
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

/// How many bytes of the PDU `policy` must see to decide; none when it must see all of them.
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
