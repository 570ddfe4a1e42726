//! The gateway's SubDevice with MainDevices by others, in programs of their own: each reaches Op over a virtual cable, reads all
//! objects, exchanges process data as fast as it can, and starts again and again.
//!
//! `MOBGATE_CYCLES=100000 MOBGATE_RESTARTS=500 cargo test --test ethercat foreign -- --nocapture` is the whole routine, which CI
//! runs; without these variables there is less of it.

mod in_process;

use std::process::Child;

use embassy_futures::select::{Either, select};
use embedded_hal_async::digital::Wait;
use ethercat_subdevice::device::Device;
use ethercat_subdevice::object::Access;
use ethercat_subdevice::sub_device::SubDevice;
use mobgate::port::ethercat::DEVICE;
use mobgate_simulator::esc::packet::{PacketSocket, serve, serve_ring};
use mobgate_simulator::own_network::{
    SECOND_MASTER_END, SECOND_SEGMENT_END, SEGMENT_END, in_own_network, lay_second_cable, start_master_with,
};
use mobgate_simulator::sub_device::{direct, line_of};

use crate::bench::gateway_objects;
use crate::outside::ends_well;

static GATEWAY: Device = DEVICE;

/// Cycles and restarts of a plain `cargo test`.
const CYCLES: u32 = 5_000;
const RESTARTS: u32 = 3;

/// An entry that can be read in PreOp.
#[derive(Debug, Clone)]
struct Listing {
    index: u16,
    sub: u8,
    bytes: usize,
    /// There may be fewer bytes.
    shorter: bool,
}

fn entries(device: &Device) -> Vec<Listing> {
    const READ_PRE_OP: Access = Access(1);
    let entries = device.objects.iter().flat_map(|object| {
        let entries = (0..=object.sub_max()).filter_map(|sub| Some((sub, object.entry(sub)?)));
        let readable = entries.filter(|(_, entry)| entry.access.any(READ_PRE_OP));
        readable.map(|(sub, entry)| Listing {
            index: object.index,
            sub,
            bytes: entry.data_type.bytes(),
            shorter: entry.data_type.may_be_shorter(),
        })
    });
    entries.collect()
}

/// The number in an environment variable, or the usual one.
fn number(variable: &str, usual: u32) -> u32 {
    std::env::var(variable).map_or(usual, |number| number.parse().expect("a number"))
}

fn cycles() -> u32 {
    number("MOBGATE_CYCLES", CYCLES)
}

/// Starts the MainDevice `name` with its routine.
fn routine(name: &str, second: Option<&str>) -> Child {
    let list = format!("{}/entries_{name}", env!("CARGO_TARGET_TMPDIR"));
    let line = |entry: Listing| {
        let Listing { index, sub, bytes, shorter } = entry;
        format!("{index:04x} {sub} {bytes} {}\n", if shorter { '<' } else { '=' })
    };
    std::fs::write(&list, entries(&GATEWAY).into_iter().map(line).collect::<String>()).unwrap();
    let numbers = [cycles(), number("MOBGATE_RESTARTS", RESTARTS)].map(|number| number.to_string());
    let arguments: Vec<_> = [list].into_iter().chain(numbers).chain(second.map(str::to_owned)).collect();
    start_master_with(name, &format!("{name}_master.py"), &arguments)
}

/// Runs the gateway's SubDevice, in a ring or not, until the MainDevice that `start` starts has ended, and ended well.
fn meets(test: &str, ring: bool, start: impl FnOnce() -> Child) {
    in_own_network(test, || {
        let line = line_of(&GATEWAY);
        let (esc, mut interrupt) = direct(line.borrow().chip(0));
        let mut sub_device = SubDevice::new(&GATEWAY, esc, gateway_objects());
        let first = PacketSocket::open(SEGMENT_END).unwrap();
        let second = ring.then(|| {
            line.borrow_mut().close_ring();
            lay_second_cable();
            PacketSocket::open(SECOND_SEGMENT_END).unwrap()
        });
        let mut script = start();
        let device = sub_device.run(async || interrupt.wait_for_high().await.unwrap());
        let both = select(device, ends_well(&mut script));
        let ended = match &second {
            Some(second) => serve_ring([&first, second], &line, both),
            None => serve(&first, &line, both),
        };
        match ended.unwrap() {
            Either::First(never) => never,
            Either::Second(()) => {}
        }
    });
}

#[test]
fn pysoem_does_its_routine() {
    meets("foreign::pysoem_does_its_routine", false, || routine("pysoem", None));
}

#[test]
fn soemx_does_its_routine() {
    meets("foreign::soemx_does_its_routine", false, || routine("soemx", None));
}

/// In a ring it needs no time-out, which on a busy machine would have to be long, and is waited for after each broadcast.
#[test]
fn kickcat_does_its_routine_in_a_ring() {
    let test = "foreign::kickcat_does_its_routine_in_a_ring";
    meets(test, true, || routine("kickcat", Some(SECOND_MASTER_END)));
}

#[test]
fn kickcat_starts_the_gateway_at_a_single_cable() {
    let test = "foreign::kickcat_starts_the_gateway_at_a_single_cable";
    meets(test, false, || start_master_with("kickcat", "kickcat_start.py", &[]));
}
