//! Devices on a wire, and their faults.

use embassy_time::{Duration, Instant, Timer, with_timeout};
use embedded_io_async::{Read, Write};
use mobgate::settings::LineSettings;

use super::{Device, Fresh, rtu, serve};
use crate::fault::{Fault, Faults, When};
use crate::wire::{LineEnd, Silence, Wire};
use crate::world::World;

const LINE: LineSettings = LineSettings { baud: 9_600, ..LineSettings::DEFAULT };
const READ: [u8; 5] = [3, 0, 0, 0, 1];

/// Sends `pdu` to `unit` and hears what comes within a second, until it is silent.
async fn ask(master: &mut LineEnd, unit: u8, pdu: &[u8]) -> Option<Vec<u8>> {
    master.write_all(&rtu::frame(unit, pdu)).await.unwrap();
    let heard = with_timeout(Duration::from_secs(1), master.frame(Silence::of(&LINE))).await.ok()?;
    Some(heard.bytes)
}

/// A wire with these devices at one connection, and a master's.
fn bus(devices: impl Into<Vec<Device>>) -> (World<'static>, Wire, LineEnd) {
    let (world, wire) = (World::new(1), Wire::new());
    world.spawn(serve(wire.tap(LINE), devices.into()));
    let master = wire.tap(LINE);
    (world, wire, master)
}

/// The response of a device with `fault` to a read of register 0.
fn spoilt(fault: Fault) -> Option<Vec<u8>> {
    let (mut world, _, mut master) =
        bus([Device::new(5).with_faults(Faults::new(7).with(When::Always, fault))]);
    world.run_until(ask(&mut master, 5, &READ))
}

#[test]
fn a_response_comes_after_the_silence_and_the_turnaround() {
    let (mut world, wire, mut master) = bus([Device::new(5)]);
    let heard = world.run_until(ask(&mut master, 5, &READ)).unwrap();
    assert_eq!(rtu::open(&heard), Some((5, &[3, 2, 5, 0][..])));
    let frames = wire.frames();
    // t3.5 at 9600 baud is 4010.42 us, then 1 ms.
    let gap = frames[1].gap_ns.unwrap();
    assert!((5_010_417..5_012_417).contains(&gap), "{gap}");
}

#[test]
fn devices_on_one_connection_respond_for_their_own_unit_only() {
    let devices = [Device::new(1), Device::new(2)];
    let (mut world, _, mut master) = bus(devices.clone());
    let second = world.run_until(ask(&mut master, 2, &READ)).unwrap();
    assert_eq!(rtu::open(&second), Some((2, &[3, 2, 2, 0][..])));
    assert_eq!(world.run_until(ask(&mut master, 3, &READ)), None);
    assert_eq!(devices[0].counters().all_requests(), 0);
    assert_eq!(devices[1].counters().requests[3], 1);
}

#[test]
fn a_broadcast_is_executed_by_all_and_answered_by_none() {
    let devices = [Device::new(1), Device::new(2)];
    let (mut world, _, mut master) = bus(devices.clone());
    assert_eq!(world.run_until(ask(&mut master, 0, &[6, 0, 9, 0x12, 0x34])), None);
    for device in devices {
        assert_eq!(device.memory().holding[9], 0x1234);
        assert!(device.writes()[0].broadcast);
    }
}

#[test]
fn a_torn_or_corrupt_request_is_counted_and_not_answered() {
    let device = Device::new(1);
    let (mut world, _, mut master) = bus([device.clone()]);
    world.run_until(async {
        let frame = rtu::frame(1, &READ);
        master.write_all(&frame[..3]).await.unwrap();
        master.flush().await.unwrap();
        Timer::after_micros(2_000).await;
        master.write_all(&frame[3..]).await.unwrap();
        Timer::after_secs(1).await;
        master.write_all(&frame[..7]).await.unwrap();
        Timer::after_secs(1).await;
    });
    let counters = device.counters();
    assert_eq!((counters.gap_inside, counters.bad_crc, counters.all_requests()), (1, 1, 0));
}

#[test]
fn fresh_registers_differ_at_every_read() {
    let (mut world, _, mut master) = bus([Device::new(1).with_fresh(100)]);
    for reads in 1..=3 {
        let heard = world.run_until(ask(&mut master, 1, &[4, 0, 100, 0, 4])).unwrap();
        let fresh = Fresh::from_response(rtu::open(&heard).unwrap().1).unwrap();
        assert_eq!(fresh.reads, reads);
        assert!(u64::from(fresh.at_us) < Instant::now().as_micros());
    }
}

#[test]
fn a_dead_device_is_silent() {
    assert_eq!(spoilt(Fault::Dead), None);
}

#[test]
fn a_late_response_does_not_keep_the_next_request_from_its_response() {
    let late = Fault::Late(Duration::from_millis(1_500), Duration::from_millis(1_500));
    let slow = Device::new(1).with_faults(Faults::new(1).with(When::Always, late));
    let (mut world, _, mut master) = bus([slow, Device::new(2)]);
    assert_eq!(world.run_until(ask(&mut master, 1, &READ)), None);
    assert_eq!(world.run_until(ask(&mut master, 2, &READ)).unwrap()[0], 2);
    let mut buffer = [0; 64];
    let count = world.run_until(master.read(&mut buffer)).unwrap();
    assert_eq!((count, buffer[0]), (1, 1), "the late response comes all the same");
}

#[test]
fn a_corrupt_response_does_not_open() {
    use Fault::{BadCrc, FlippedBit, LostByte, NoiseAfter, NoiseBefore, Truncated};
    for fault in [BadCrc, FlippedBit, LostByte, Truncated, NoiseBefore(3), NoiseAfter(3)] {
        let heard = spoilt(fault).unwrap();
        assert_eq!(rtu::open(&heard), None, "{fault:?}: {heard:x?}");
    }
}

#[test]
fn a_forged_response_opens_and_is_another() {
    let forged = |fault| {
        let heard = spoilt(fault).unwrap();
        let (unit, pdu) = rtu::open(&heard).unwrap();
        (unit, pdu.to_vec())
    };
    assert_eq!(forged(Fault::WrongUnit), (6, vec![3, 2, 5, 0]));
    assert_eq!(forged(Fault::WrongFunction), (5, vec![2, 2, 5, 0]));
    assert_eq!(forged(Fault::WrongLength), (5, vec![3, 4, 5, 0, 0x12, 0x34]));
    assert_eq!(forged(Fault::Exception(6)), (5, vec![0x83, 6]));
}

#[test]
fn a_gap_inside_splits_the_response_on_the_wire() {
    let gap = Fault::GapInside(Duration::from_millis(20));
    let device = Device::new(5).with_faults(Faults::new(7).with(When::Requests(2..=2), gap));
    let (mut world, _, mut master) = bus([device.clone()]);
    assert_eq!(world.run_until(ask(&mut master, 5, &READ)).unwrap().len(), 7);
    assert_eq!(world.run_until(ask(&mut master, 5, &READ)).unwrap().len(), 3);
    assert_eq!(device.faults_injected(), 1);
}

/// What a master hears that sends these requests to unit 5, so many milliseconds from the start on: the registers read, and when
/// the responses have come, in milliseconds.
fn responses(device: Device, requests: &[(u64, u8)]) -> Vec<(u8, u64)> {
    let (mut world, wire, mut sender) = bus([device]);
    let hearer = wire.tap(LINE);
    let number = sender.number();
    let requests = requests.to_vec();
    world.spawn(async move {
        for (at_ms, register) in requests {
            Timer::at(Instant::from_millis(at_ms)).await;
            sender.write_all(&rtu::frame(5, &[3, 0, register, 0, 1])).await.unwrap();
        }
    });
    let mut heard = Vec::new();
    while let Some((bytes, at)) = world.run_until(async {
        let frame = with_timeout(Duration::from_secs(20), hearer.frame(Silence::of(&LINE))).await.ok()?;
        Some((frame.bytes, Instant::now().as_millis()))
    }) {
        if let Some((5, &[3, 2, 5, register])) = rtu::open(&bytes) {
            heard.push((register, at));
        }
    }
    assert_eq!(wire.collisions(), 0);
    let of_device: Vec<_> = wire.frames().into_iter().filter(|frame| frame.from != number).collect();
    assert_eq!(of_device.len(), heard.len(), "each response is a frame of its own");
    heard
}

#[test]
fn a_late_response_delays_those_behind_it() {
    let late = Fault::Late(Duration::from_secs(2), Duration::from_secs(2));
    let device = Device::new(5).with_faults(Faults::new(1).with(When::Requests(1..=1), late));
    let heard = responses(device, &[(0, 1), (500, 2), (2_500, 3)]);
    assert_eq!(heard.iter().map(|(register, _)| *register).collect::<Vec<_>>(), [1, 2, 3]);
    assert!(heard[0].1 > 2_000 && heard[1].1 < 2_050 && heard[2].1 < 2_550, "{heard:?}");
}

#[test]
fn two_halves_of_a_response_have_no_other_between_them() {
    let pause = Duration::from_millis(300);
    let halves = Faults::new(1).with(When::Requests(1..=1), Fault::GapInside(pause));
    let (mut world, _, mut master) = bus([Device::new(5).with_faults(halves)]);
    let mut ask = |register| world.run_until(ask(&mut master, 5, &[3, 0, register, 0, 1])).unwrap();
    let good = rtu::frame(5, &[3, 2, 5, 1]);
    assert_eq!(ask(1), good[..3]);
    // Asked between the halves.
    assert_eq!(ask(2), good[3..]);
    let mut buffer = [0; 64];
    let mut hear = async || {
        let count = master.read(&mut buffer).await.unwrap();
        buffer[..count].to_vec()
    };
    assert_eq!(world.run_until(hear()), [5], "then the other one");
}

#[test]
fn responses_in_a_stream_are_whole_and_in_rtu_in_order() {
    for (in_order, expected) in [(true, vec![1, 1, 2]), (false, vec![2, 1, 1])] {
        let mut world = World::new(1);
        let late = Fault::Late(Duration::from_secs(2), Duration::from_secs(2));
        let gap = Fault::GapInside(Duration::from_secs(2));
        let first = || When::Requests(1..=1);
        let device = Device::new(5).with_faults(Faults::new(1).with(first(), late).with(first(), gap));
        let mut outbox = super::Outbox::new();
        let mut ask = |register| {
            let frame = |unit, pdu: &[u8], _| rtu::frame(unit, pdu);
            device.asked(&[3, 0, register, 0, 1], in_order, frame, &mut outbox);
        };
        ask(1);
        ask(2);
        let mut pieces = Vec::new();
        for _ in 0..3 {
            let crate::fault::Sent::Bytes(bytes) = world.run_until(outbox.due()) else { panic!() };
            pieces.push(bytes);
        }
        let [one, two] = [1, 2].map(|register| rtu::frame(5, &[3, 2, 5, register]));
        let is = |piece: &Vec<u8>| {
            if *piece == two { 2 } else { u8::from(one[..3] == **piece || one[3..] == **piece) }
        };
        assert_eq!(pieces.iter().map(is).collect::<Vec<_>>(), expected);
    }
}

#[test]
fn a_device_in_a_hiccup_answers_all_that_it_has_heard_when_it_ends() {
    let hiccup = Fault::Hiccup(Duration::from_secs(2), Duration::from_secs(2));
    let device = Device::new(5).with_faults(Faults::new(1).with(When::Always, hiccup));
    let heard = responses(device, &[(0, 1), (500, 2), (1_500, 3), (2_500, 4)]);
    assert_eq!(heard.iter().map(|(register, _)| *register).collect::<Vec<_>>(), [1, 2, 3, 4]);
    assert!(heard[0].1 > 2_000 && heard[2].1 < 2_080, "{heard:?}");
    assert!(heard[3].1 > 4_500, "the next one begins behind the first, {heard:?}");
}

#[test]
fn a_request_that_is_lost_is_not_carried_out_and_one_whose_response_is_lost_is() {
    for (fault, written) in [(Fault::Unheard, 0), (Fault::Dead, 1)] {
        let device = Device::new(5).with_faults(Faults::new(1).with(When::Always, fault));
        let (mut world, _, mut master) = bus([device.clone()]);
        assert_eq!(world.run_until(ask(&mut master, 5, &[6, 0, 1, 0, 2])), None);
        assert_eq!(device.writes().len(), written, "{fault:?}");
        assert_eq!(device.faults_injected(), 1);
    }
}
