//! The gateway's SubDevice with MainDevices by others, in programs of their own: each reaches Op over a virtual cable, reads all
//! objects, exchanges process data as fast as it can, and starts again and again.
//!
//! `MOBGATE_CYCLES=100000 MOBGATE_RESTARTS=500 cargo test --test ethercat foreign -- --nocapture` is the whole routine, which CI
//! runs; without these variables there is less of it.

mod in_process;

use std::process::Child;

use ethercat_subdevice::catalogue::Catalogue;
use ethercat_subdevice::object::Access;
use mobgate::fieldbus::MODULAR;
use mobgate_simulator::esc::packet::{PacketSocket, serve, serve_ring};
use mobgate_simulator::own_network::{
    SECOND_MASTER_END, SECOND_SEGMENT_END, SEGMENT_END, in_own_network, lay_second_cable, start_master_with,
};

use crate::outside::ends_well;
use crate::prelude::*;

static WITH_MODULES: Device = MODULAR;
/// A device of each type, and an empty slot between.
const MODULES: &str = "port ecat ethercat modules
slave 0 unit 1 coil 0 count 9 discrete 0 count 11 input 0 count 2 as f32 holding 0 count 2 as i16
slave 1 unit 2
slave 2 unit 3 input 0 count 1 as u32 holding 0 count 1 as i32 order 2301";

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
    /// It is a bit.
    bit: bool,
    /// What it holds, where that is known.
    known: Option<Vec<u8>>,
}

fn entries(device: &Device) -> Vec<Listing> {
    listings(device.objects.iter().copied())
}

fn listings(objects: impl Iterator<Item = Object>) -> Vec<Listing> {
    const READ_PRE_OP: Access = Access(1);
    let entries = objects.flat_map(|object| {
        let entries = (0..=object.sub_max()).filter_map(|sub| Some((sub, object.entry(sub)?)));
        let readable = entries.filter(|(_, entry)| entry.access.any(READ_PRE_OP));
        let readable = readable.map(|(sub, entry)| Listing {
            index: object.index,
            sub,
            bytes: entry.data_type.bytes(),
            shorter: entry.data_type.may_be_shorter(),
            bit: entry.data_type == DataType::Bool,
            known: None,
        });
        readable.collect::<Vec<_>>()
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

/// Starts the MainDevice `name` with its routine, for a device with these `entries`.
fn routine(name: &str, entries: Vec<Listing>, second: Option<&str>) -> Child {
    // Tests run beside each other.
    let list = format!("{}/entries_{name}_{}", env!("CARGO_TARGET_TMPDIR"), entries.len());
    let line = |entry: Listing| {
        let Listing { index, sub, bytes, shorter, bit, known } = entry;
        let kind = if shorter {
            '<'
        } else if bit {
            'b'
        } else {
            '='
        };
        let known: String = known.iter().flatten().map(|byte| format!("{byte:02x}")).collect();
        format!("{index:04x} {sub} {bytes} {kind} {known}\n")
    };
    std::fs::write(&list, entries.into_iter().map(line).collect::<String>()).unwrap();
    let numbers = [cycles(), number("MOBGATE_RESTARTS", RESTARTS)].map(|number| number.to_string());
    let arguments: Vec<_> = [list].into_iter().chain(numbers).chain(second.map(str::to_owned)).collect();
    start_master_with(name, &format!("{name}_master.py"), &arguments)
}

/// The gateway with [`MODULES`], whose devices have these values, and all entries that it has then.
fn modules() -> (GatewayObjects<'static>, Vec<Listing>) {
    let place = place_with(MODULES);
    // Coils, switches, input and holding registers of the first; input and holding registers of the other.
    let image = [
        &[0b1010_0101, 1, 0xff, 0b101][..],
        &2.5_f32.to_be_bytes(),
        &(-1e9_f32).to_be_bytes(),
        &(-2_i16).to_be_bytes(),
        &1_234_i16.to_be_bytes(),
        &3_000_000_000_u32.to_be_bytes(),
        &(-70_000_i32).to_be_bytes(),
    ]
    .concat();
    place.scanner().with(|scanner| scanner.image_mut(0, image.len() as u16).copy_from_slice(&image));
    let objects = GatewayObjects::modular(place);
    let mut entries = listings(Catalogue { device: &WITH_MODULES, application: &objects }.objects_from(0));
    let known = [
        (0x6000, 9, vec![1]),
        (0x6000, 10, vec![0]),
        (0x6001, 1, vec![1]),
        (0x6001, 2, vec![0]),
        (0x6002, 1, 2.5_f32.to_le_bytes().to_vec()),
        (0x6002, 2, (-1e9_f32).to_le_bytes().to_vec()),
        (0x6003, 1, (-2_i16).to_le_bytes().to_vec()),
        (0x6003, 2, 1_234_i16.to_le_bytes().to_vec()),
        (0x6022, 1, 3_000_000_000_u32.to_le_bytes().to_vec()),
        (0x6023, 1, (-70_000_i32).to_le_bytes().to_vec()),
        (0xf000, 2, vec![32, 0]),
    ];
    for (index, sub, value) in known {
        let entry = entries.iter_mut().find(|entry| (entry.index, entry.sub) == (index, sub));
        entry.unwrap().known = Some(value);
    }
    (objects, entries)
}

/// The gateway as it is after power-on.
fn meets(test: &str, ring: bool, start: impl FnOnce(Vec<Listing>) -> Child) {
    meets_device(test, &GATEWAY, ring, || (gateway_objects(), entries(&GATEWAY)), start);
}

/// The gateway with modules.
fn meets_modules(test: &str, ring: bool, start: impl FnOnce(Vec<Listing>) -> Child) {
    meets_device(test, &WITH_MODULES, ring, modules, start);
}

/// Runs the gateway's SubDevice, in a ring or not, until the MainDevice that `start` starts has ended, and ended well.
fn meets_device(
    test: &str,
    device: &'static Device,
    ring: bool,
    objects: impl FnOnce() -> (GatewayObjects<'static>, Vec<Listing>),
    start: impl FnOnce(Vec<Listing>) -> Child,
) {
    in_own_network(test, || {
        let line = line_of(device);
        let (esc, mut interrupt) = direct(line.borrow().chip(0));
        let (objects, entries) = objects();
        let mut sub_device = SubDevice::new(device, esc, objects);
        let first = PacketSocket::open(SEGMENT_END).unwrap();
        let second = ring.then(|| {
            line.borrow_mut().close_ring();
            lay_second_cable();
            PacketSocket::open(SECOND_SEGMENT_END).unwrap()
        });
        let mut script = start(entries);
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
    meets("foreign::pysoem_does_its_routine", false, |entries| routine("pysoem", entries, None));
}

#[test]
fn soemx_does_its_routine() {
    meets("foreign::soemx_does_its_routine", false, |entries| routine("soemx", entries, None));
}

/// In a ring it needs no time-out, which on a busy machine would have to be long, and is waited for after each broadcast.
#[test]
fn kickcat_does_its_routine_in_a_ring() {
    let test = "foreign::kickcat_does_its_routine_in_a_ring";
    meets(test, true, |entries| routine("kickcat", entries, Some(SECOND_MASTER_END)));
}

#[test]
fn kickcat_starts_the_gateway_at_a_single_cable() {
    let test = "foreign::kickcat_starts_the_gateway_at_a_single_cable";
    meets(test, false, |_| start_master_with("kickcat", "kickcat_start.py", &[]));
}

#[test]
fn pysoem_does_its_routine_with_modules() {
    let test = "foreign::pysoem_does_its_routine_with_modules";
    meets_modules(test, false, |entries| routine("pysoem", entries, None));
}

#[test]
fn soemx_does_its_routine_with_modules() {
    let test = "foreign::soemx_does_its_routine_with_modules";
    meets_modules(test, false, |entries| routine("soemx", entries, None));
}

#[test]
fn kickcat_does_its_routine_with_modules_in_a_ring() {
    let test = "foreign::kickcat_does_its_routine_with_modules_in_a_ring";
    meets_modules(test, true, |entries| routine("kickcat", entries, Some(SECOND_MASTER_END)));
}
