//! The bench for SubDevices, and the gateway's objects on it.

use mobgate::fieldbus::{EthercatState, GatewayObjects};
use mobgate::language::apply;
use mobgate::settings::Settings;

pub(crate) use mobgate_simulator::esc::bench::*;

/// The gateway's objects, with a port that never asks.
pub(crate) fn gateway_objects() -> GatewayObjects<'static> {
    GatewayObjects::new(place_with("port ecat ethercat"))
}

/// Prints a figure, and demands that it is at most so much.
pub(crate) fn at_most(name: &str, value: u64, unit: &str, most: u64) {
    let verdict = if value <= most { "ok" } else { "short" };
    // The name of the test is on this line already where tests run one by one.
    println!("\nfigure {name} {value} {unit} <={most} {verdict}");
    assert!(value <= most, "{name}: {value} {unit}");
}

/// What a gateway with such settings shares with its SubDevice.
pub(crate) fn place_with(lines: &str) -> &'static EthercatState {
    // A place is there for as long as the gateway runs: here, as long as the test.
    let place = Box::leak(Box::new(EthercatState::new()));
    let mut settings = Settings::new();
    for line in lines.lines() {
        apply(&mut settings, line).unwrap();
    }
    place.follow(&settings, !settings.slaves.is_empty());
    place
}
