//! Random TCP devices with faults, behind a TCP client with random settings, drawn from a seed.
//!
//! Whatever happens, every request gets exactly one response, it is the requester's own, its values are of now, no write is
//! carried out twice, and every frame is back in the pool at the end.

use crate::prelude::*;
use crate::visitors::{Visits, draw_device, draw_path, draw_words, wrote_once};

/// Worlds of a plain `cargo test`.
const SEEDS: u64 = 300;
/// Of all responses that the devices could give, in per cent.
const GOOD_MIN: f64 = 35.0;
const SERVER: &str = "10.0.1.1:502";
const DEVICES: u8 = 4;

#[test]
fn random_tcp_devices_keep_no_response_from_its_requester() {
    each_world(SEEDS, "tcp_torture_good", GOOD_MIN, live);
}

fn live(seed: u64, share: &Share) {
    let mut random = Random::new(seed);
    let rtu = random.chance(0.3);
    let settings = format!(
        "port plc tcp client {SERVER} {}
         port P502 tcp server 502 lifetime 5s
         route P502 * * * plc",
        draw_words(&mut random, rtu)
    );
    with_gateway(seed, &settings, |world, rig| {
        let strays = random.chance(0.25);
        let devices: Vec<Device> = (1..=DEVICES)
            .map(|unit| draw_device(&mut random, unit, (4, 30), |random| draw_fault(random, rtu, strays)))
            .collect();
        rig.network.set_path(SERVER.parse().unwrap(), draw_path(&mut random, 3_000, 100));
        rig.attach_at(world, SERVER, rtu, devices.clone());
        let target = |random: &mut Random| {
            let unit = random.within(1..=u64::from(DEVICES) + 1) as u8;
            (unit, (unit <= DEVICES).then_some(unit))
        };
        // Of the device with a bit turned: 06 and 07.
        let visits = Visits { bursts: 30, target, exceptions: &[0x06, 0x07, 0x0a, 0x0b] };
        visits.run(world, rig, &mut random, share);
        devices.iter().for_each(wrote_once);
    });
}

/// By RTU, responses go astray or are late without a bound: a stray one is the late one of another for all that anybody can tell.
fn draw_fault(random: &mut Random, rtu: bool, strays: bool) -> Fault {
    let late = if rtu && strays { Fault::WrongUnit } else { Fault::draw_late(random) };
    let common = [
        Fault::Dead,
        Fault::Unheard,
        late,
        late,
        Fault::WrongFunction,
        Fault::WrongLength,
        Fault::Exception(6),
        Fault::Close,
        Fault::Reset,
        Fault::Half,
    ];
    // MBAP has no checksum: what is corrupt there, TCP has let through, and nobody can tell.
    let only = match rtu {
        true => {
            [Fault::BadCrc, Fault::FlippedBit, Fault::LostByte, Fault::NoiseBefore(3), Fault::NoiseAfter(3)]
        }
        false => [
            Fault::WrongTransaction,
            Fault::WrongUnit,
            Fault::Half,
            Fault::Twice(Duration::from_millis(3)),
            late,
        ],
    };
    let all = [&common[..], &only[..]].concat();
    all[random.index(all.len())]
}
