//! Devices on a wire, and their faults.

use embassy_time::{Duration, Instant, Timer, with_timeout};
use embedded_io_async::{Read, Write};
use mobgate::config::LineSettings;

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

/// The answer of a device with `fault` to a read of register 0.
fn spoilt(fault: Fault) -> Option<Vec<u8>> {
    let wire = Wire::new();
    let mut world = World::new(1);
    let device = Device::new(5).with_faults(Faults::new(7).with(When::Always, fault));
    world.spawn(device.run(wire.tap(LINE)));
    world.run_until(ask(&mut wire.tap(LINE), 5, &READ))
}

#[test]
fn an_answer_comes_after_the_silence_and_the_turnaround() {
    let wire = Wire::new();
    let mut world = World::new(1);
    world.spawn(Device::new(5).run(wire.tap(LINE)));
    let mut master = wire.tap(LINE);
    let heard = world.run_until(ask(&mut master, 5, &READ)).unwrap();
    assert_eq!(rtu::open(&heard), Some((5, &[3, 2, 5, 0][..])));
    let frames = wire.frames();
    // t3.5 at 9600 baud is 4010.42 us, then 1 ms.
    let gap = frames[1].gap_ns.unwrap();
    assert!((5_010_417..5_012_417).contains(&gap), "{gap}");
}

#[test]
fn devices_on_one_connection_answer_for_their_own_unit_only() {
    let wire = Wire::new();
    let mut world = World::new(1);
    let devices = vec![Device::new(1), Device::new(2)];
    world.spawn(serve(wire.tap(LINE), devices.clone()));
    let mut master = wire.tap(LINE);
    let second = world.run_until(ask(&mut master, 2, &READ)).unwrap();
    assert_eq!(rtu::open(&second), Some((2, &[3, 2, 2, 0][..])));
    assert_eq!(world.run_until(ask(&mut master, 3, &READ)), None);
    assert_eq!(devices[0].counters().all_requests(), 0);
    assert_eq!(devices[1].counters().requests[3], 1);
}

#[test]
fn a_broadcast_is_executed_by_all_and_answered_by_none() {
    let wire = Wire::new();
    let mut world = World::new(1);
    let devices = vec![Device::new(1), Device::new(2)];
    world.spawn(serve(wire.tap(LINE), devices.clone()));
    let answer = world.run_until(ask(&mut wire.tap(LINE), 0, &[6, 0, 9, 0x12, 0x34]));
    assert_eq!(answer, None);
    for device in devices {
        assert_eq!(device.memory().holding[9], 0x1234);
        assert!(device.writes()[0].broadcast);
    }
}

#[test]
fn a_torn_or_damaged_request_is_counted_and_not_answered() {
    let wire = Wire::new();
    let mut world = World::new(1);
    let device = Device::new(1);
    world.spawn(device.clone().run(wire.tap(LINE)));
    let mut master = wire.tap(LINE);
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
    let wire = Wire::new();
    let mut world = World::new(1);
    world.spawn(Device::new(1).with_fresh(100).run(wire.tap(LINE)));
    let mut master = wire.tap(LINE);
    for reads in 1..=3 {
        let heard = world.run_until(ask(&mut master, 1, &[4, 0, 100, 0, 4])).unwrap();
        let fresh = Fresh::from_answer(rtu::open(&heard).unwrap().1).unwrap();
        assert_eq!(fresh.reads, reads);
        assert!(u64::from(fresh.at_us) < Instant::now().as_micros());
    }
}

#[test]
fn a_dead_device_is_silent() {
    assert_eq!(spoilt(Fault::Dead), None);
}

#[test]
fn a_late_answer_does_not_keep_the_next_request_from_its_answer() {
    let wire = Wire::new();
    let mut world = World::new(1);
    let late = Fault::Late(Duration::from_millis(1_500), Duration::from_millis(1_500));
    let slow = Device::new(1).with_faults(Faults::new(1).with(When::Always, late));
    world.spawn(serve(wire.tap(LINE), vec![slow, Device::new(2)]));
    let mut master = wire.tap(LINE);
    assert_eq!(world.run_until(ask(&mut master, 1, &READ)), None);
    let quick = world.run_until(ask(&mut master, 2, &READ)).unwrap();
    assert_eq!(quick[0], 2);
    let mut buffer = [0; 64];
    let count = world.run_until(master.read(&mut buffer)).unwrap();
    assert_eq!((count, buffer[0]), (1, 1), "the late answer comes all the same");
}

#[test]
fn a_damaged_answer_does_not_open() {
    let damages = [
        Fault::BadCrc,
        Fault::FlippedBit,
        Fault::LostByte,
        Fault::Truncated,
        Fault::NoiseBefore(3),
        Fault::NoiseAfter(3),
    ];
    for fault in damages {
        let heard = spoilt(fault).unwrap();
        assert_eq!(rtu::open(&heard), None, "{fault:?}: {heard:x?}");
    }
}

#[test]
fn a_forged_answer_opens_and_is_another() {
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
fn a_gap_inside_splits_the_answer_on_the_wire() {
    let wire = Wire::new();
    let mut world = World::new(1);
    let gap = Fault::GapInside(Duration::from_millis(20));
    let device = Device::new(5).with_faults(Faults::new(7).with(When::Requests(2..=2), gap));
    world.spawn(device.clone().run(wire.tap(LINE)));
    let mut master = wire.tap(LINE);
    assert_eq!(world.run_until(ask(&mut master, 5, &READ)).unwrap().len(), 7);
    assert_eq!(world.run_until(ask(&mut master, 5, &READ)).unwrap().len(), 3);
    assert_eq!(device.faults_injected(), 1);
}
