//! Random servers with faults behind one TCP client on a few sockets, drawn from a seed.
//!
//! Whatever happens, every request gets exactly one response, it is of the unit that was asked, its values are of now, no write is
//! carried out twice, there are never more connections than allowed, and every frame is back in the pool at the end.

use crate::prelude::*;
use crate::visitors::{Visits, draw_device, draw_path, draw_words, wrote_once};

/// Worlds of a plain `cargo test`.
const SEEDS: u64 = 200;
/// Of all responses that the devices could give, in per cent.
const GOOD_MIN: f64 = 35.0;
/// What servers call their units less than the gateway does.
const SHIFT: u8 = 100;

#[test]
fn random_servers_keep_no_response_from_its_requester() {
    each_world(SEEDS, "servers_torture_good", GOOD_MIN, live);
}

fn address(server: u8) -> SocketAddr {
    SocketAddr::from(([10, 0, 1, server], 502))
}

fn live(seed: u64, share: &Share) {
    let mut random = Random::new(seed);
    let rtu = random.chance(0.3);
    let count = random.within(2..=9) as u8;
    let sockets = random.within(1..=5);
    let shifted: Vec<bool> = (0..count).map(|_| random.chance(0.3)).collect();
    // Two units at each: 10 and 11 at the first, 20 and 21 at the second one.
    let lines: String = (1..=count)
        .map(|n| {
            let (base, tag) = match shifted[usize::from(n) - 1] {
                true => (10 * n + SHIFT, format!("tag -{SHIFT}")),
                false => (10 * n, String::new()),
            };
            format!("server plant unit {base}-{} at {} {tag}\n", base + 1, address(n))
        })
        .collect();
    let settings = format!(
        "port plant tcp client {} sockets {sockets}
         port P502 tcp server 502 lifetime 5s
         {lines}
         route P502 * * * plant",
        draw_words(&mut random, rtu)
    );
    with_gateway(seed, &settings, |world, rig| {
        // Of the board's, which may be fewer than the port's.
        let board = (!settings.contains("idle 0") && random.chance(0.3)).then(|| random.within(1..=5));
        board.into_iter().for_each(|board| rig.network.set_sockets(board as usize));
        let mut devices = Vec::new();
        for n in 1..=count {
            let pair = [10 * n, 10 * n + 1]
                .map(|unit| draw_device(&mut random, unit, (3, 30), |random| draw_fault(random, rtu)));
            rig.network.set_path(address(n), draw_path(&mut random, 3_000, 100));
            rig.attach_at(world, &address(n).to_string(), rtu, pair.clone());
            devices.extend(pair);
        }
        // Servers go away and come back.
        let (network, mut weather) = (rig.network.clone(), random.fork());
        world.spawn(async move {
            for _ in 0..10 {
                Timer::after_millis(weather.within(0..=300)).await;
                let server = address(weather.within(1..=u64::from(count)) as u8);
                network.set_unreachable(server, true);
                Timer::after_millis(weather.within(0..=700)).await;
                network.set_unreachable(server, false);
            }
        });
        let target = move |random: &mut Random| {
            let server = random.index(shifted.len());
            let device = 10 * (server as u8 + 1) + random.byte() % 2;
            let unit = if shifted[server] { device + SHIFT } else { device };
            // Every seventh is for a unit that no server has.
            if random.chance(0.14) { (9, None) } else { (unit, Some(device)) }
        };
        let visits = Visits { bursts: 20, target, exceptions: &[0x06, 0x0a, 0x0b] };
        visits.run(world, rig, &mut random, share);
        let most = rig.network.counters().sockets_most;
        assert!(most <= sockets.min(board.unwrap_or(u64::MAX)), "{most} sockets at a time");
        devices.iter().for_each(wrote_once);
    });
}

fn draw_fault(random: &mut Random, rtu: bool) -> Fault {
    let late = Fault::draw_late(random);
    let common = [
        Fault::Dead,
        Fault::Unheard,
        late,
        late,
        Fault::Exception(6),
        Fault::Close,
        Fault::Reset,
        Fault::Half,
    ];
    match random.index(12) {
        nth @ 0..8 => common[nth],
        8 if rtu => Fault::BadCrc,
        9 if rtu => Fault::NoiseBefore(3),
        8 => Fault::WrongTransaction,
        9 => Fault::Twice(Duration::from_millis(3)),
        10 => Fault::WrongFunction,
        _ => Fault::WrongLength,
    }
}
