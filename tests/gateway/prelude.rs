//! What many of these tests use.

pub(crate) use embassy_time::{Duration, Instant, Timer};
pub(crate) use embedded_io_async::{Read, Write};
pub(crate) use mobgate::gateway::outstanding::Purpose;
pub(crate) use mobgate::gateway::unit_health::Ready;
pub(crate) use mobgate::modbus::Exception;
pub(crate) use mobgate::scanner::{
    DeviceId, ErrorCode, Kind, Reading, Refused, Row, RowId, Scanner, Status, Writing,
};
pub(crate) use mobgate::settings::{Framing, PortId, Priority, Settings};
pub(crate) use mobgate::stats::{Event, LastError};
pub(crate) use mobgate_simulator::client::Response;
pub(crate) use mobgate_simulator::client::session::Session;
pub(crate) use mobgate_simulator::console::typed;
pub(crate) use mobgate_simulator::device::{Fresh, rtu};
pub(crate) use mobgate_simulator::fault::When;
pub(crate) use mobgate_simulator::net::Path;
pub(crate) use mobgate_simulator::rig::{Rig, Size, machine, settings_of, with_gateway};
pub(crate) use mobgate_simulator::share::{Share, each_world};
pub(crate) use mobgate_simulator::{Client, Device, Fault, Faults, Master, Random, World, framing, rig};
pub(crate) use proptest::prelude::*;
pub(crate) use std::collections::HashMap;
pub(crate) use std::net::{IpAddr, SocketAddr};

pub(crate) const MS: Duration = Duration::from_millis(1);
pub(crate) const SECOND: Duration = Duration::from_secs(1);
/// A server in the network.
pub(crate) const PLC: &str = "10.0.1.1:502";
/// A read of a register that tells whose it is.
pub(crate) const READ: [u8; 5] = [3, 0, 7, 0, 1];

/// What the device `unit` responds to [`READ`].
pub(crate) fn value(unit: u8) -> Response {
    Response::Pdu(vec![3, 2, unit, 7])
}

pub(crate) fn address(text: &str) -> SocketAddr {
    text.parse().unwrap()
}

/// A session of the machine `host` that has sent these requests, each with its unit.
pub(crate) fn asking(
    world: &mut World<'_>,
    rig: &Rig<'_>,
    host: u8,
    requests: impl IntoIterator<Item = (u8, [u8; 5])>,
) -> Session {
    let mut session = Session::start(rig.network.connect(machine(host), 502).unwrap(), world);
    for (unit, pdu) in requests {
        world.run_until(session.send(unit, &pdu));
    }
    session
}
