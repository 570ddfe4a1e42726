//! Random worlds: lines, devices with faults, clients that misbehave, all drawn from a seed.
//!
//! Whatever happens, every request gets exactly one response, it is the requester's own, its values are of now, every frame is
//! back in the pool at the end, and the gateway never speaks before the line was silent for t3.5.
//!
//! `MOBGATE_SEED=17 cargo test torture` runs the world of seed 17 alone; `MOBGATE_SEEDS=4000` runs so many, as CI does.

use embassy_time::Duration;
use mobgate::settings::Framing;
use mobgate_simulator::rig::{Rig, with_gateway};
use mobgate_simulator::torture::{Share, draw_device, torture};
use mobgate_simulator::{Device, Fault, Random, World};

use crate::visitors::{Target, Visits};

/// Worlds of a plain `cargo test`.
const SEEDS: u64 = 300;
/// Of all responses that the devices could give, in per cent.
const GOOD_MIN: f64 = 70.0;
const BAUDS: [u32; 4] = [4_800, 9_600, 19_200, 115_200];
/// Devices 1 to this on each line; two more ids are asked for and belong to nobody.
const DEVICES: u8 = 4;
/// Units of the second line as clients write them: 100 higher.
const TAG: u8 = 100;
/// How old a response for the units of the second line may be on port 503.
const CACHE: Duration = Duration::from_millis(200);

#[test]
fn random_worlds_keep_the_promises() {
    torture("torture_good", GOOD_MIN, SEEDS, live);
}

fn live(seed: u64, share: &Share) {
    let mut random = Random::new(seed);
    let bauds = [0, 1].map(|_| BAUDS[random.index(BAUDS.len())]);
    // In some worlds most clients want to know the same.
    let herd = random.chance(0.5).then(|| random.within(1..=u64::from(DEVICES)) as u8);
    let [merge, other_merge] =
        [0, 1].map(|_| ["", "merge off", "merge adjacent", "merge near 20"][random.index(4)]);
    let settings = format!(
        "port A serial a rtu client {} 8E1 timeout {}ms retries {} down-after {}
         port B serial b rtu client {} 8N1 timeout {}ms
         port P502 tcp server 502 clients {} pipeline {} lifetime {}ms
         port P503 tcp server 503 clients 8 idle 2s
         route P502 1-{DEVICES} * * A {other_merge}
         route P502 5-6 * * A readonly
         route P502 101-106 * -{TAG} B priority high {merge}
         route P503 101-106 * -{TAG} B cache {}ms {merge}
         route P503 1-6 10.0.0.0/28 * A priority low",
        bauds[0],
        [50, 50, 60, 300][random.index(4)],
        random.index(3),
        random.index(4),
        bauds[1],
        [50, 50, 60, 300][random.index(4)],
        random.within(1..=6),
        random.within(1..=16),
        random.within(500..=20_000),
        CACHE.as_millis(),
    );
    with_gateway(seed, &settings, |world, rig| {
        for line in ["a", "b"] {
            connect_devices(world, rig, line, &mut random);
        }
        let target = move |random: &mut Random, port| {
            let tag = [0, TAG][random.index(2)];
            let common = herd.filter(|_| random.chance(0.7));
            let unit = common.unwrap_or_else(|| random.within(1..=u64::from(DEVICES) + 3) as u8);
            // The device says busy, or the fault on top of it turns a bit of that.
            let from_device: &[u8] = &[0x06, 0x07, 0x0b];
            let exceptions: [&[u8]; 2] = match unit {
                7.. => [&[0x06, 0x0a]; 2],
                // These are read-only there.
                5..=6 if port == 502 && tag == 0 => [from_device, &[0x06, 0x01]],
                _ => [from_device; 2],
            };
            let age = if port == 503 && tag == TAG { CACHE } else { Duration::from_ticks(0) };
            let device = (unit <= DEVICES).then_some(unit);
            Target { unit: unit + tag, device, exceptions, herd: common.is_some(), age }
        };
        let visits = Visits { clients: 10, bursts: 30, parts: true, target };
        visits.run(world, rig, &[502, 503], &mut random, share);
        for line in ["a", "b"] {
            let end = (rig.end(line), Framing::Rtu);
            let hasty = rig.wire(line).hasty_frames(end, Duration::from_ticks(0), Duration::from_ticks(0));
            assert_eq!(hasty, [], "line {line}");
        }
    });
}

/// Puts the devices on a line.
fn connect_devices<'w>(world: &World<'w>, rig: &Rig<'w>, line: &str, random: &mut Random) {
    let strays = random.chance(0.25);
    let devices: Vec<Device> = (1..=DEVICES)
        .map(|unit| draw_device(random, unit, (2, 40), |random| draw_fault(random, strays)))
        .collect();
    rig.attach(world, line, devices);
}

/// One that may happen on a line; answers go astray there, or are late without a bound. A stray one is the late one of another for
/// all that anybody can tell: of devices that the gateway may rely on, none sends a second response in another's name.
fn draw_fault(random: &mut Random, strays: bool) -> Fault {
    let pause = Duration::from_micros(random.within(2_000..=20_000));
    let late = if strays { Fault::WrongUnit } else { Fault::draw_late(random) };
    let faults = [
        Fault::Dead,
        Fault::Unheard,
        late,
        late,
        late,
        late,
        Fault::BadCrc,
        Fault::FlippedBit,
        Fault::LostByte,
        Fault::Truncated,
        Fault::WrongFunction,
        Fault::WrongLength,
        Fault::WrongEcho,
        Fault::NoiseBefore(3),
        Fault::NoiseAfter(3),
        Fault::GapInside(pause),
        Fault::Exception(6),
    ];
    faults[random.index(faults.len())]
}
