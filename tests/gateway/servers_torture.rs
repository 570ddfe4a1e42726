//! Random servers with faults behind one TCP client on a few sockets, drawn from a seed.
//!
//! Whatever happens, every request gets exactly one answer, it is of the unit that was asked, its values are of now, no write is
//! carried out twice, there are never more connections than allowed, and every frame is back in the pool at the end.
//!
//! `MOBGATE_SEED=17 cargo test servers_torture` runs the world of seed 17 alone; `MOBGATE_SEEDS=4000` runs so many.

use std::collections::HashMap;
use std::net::SocketAddr;

use embassy_time::{Duration, Instant, Timer};
use mobgate_simulator::client::NoReply;
use mobgate_simulator::device::Fresh;
use mobgate_simulator::fault::When;
use mobgate_simulator::net::Path;
use mobgate_simulator::random::each_seed;
use mobgate_simulator::rig::{machine, with_gateway};
use mobgate_simulator::share::Share;
use mobgate_simulator::{Client, Device, Fault, Faults, Random};

/// Worlds of a plain `cargo test`.
const SEEDS: u64 = 200;
/// Of all answers that the devices could give, in per cent.
const GOOD_MIN: f64 = 35.0;
const FRESH: u16 = 100;
/// What servers call their units less than the gateway does.
const SHIFT: u8 = 100;

#[test]
fn random_servers_keep_no_answer_from_its_asker() {
    let share = Share::default();
    each_seed(SEEDS, |seed| live(seed, &share));
    share.demand("servers_torture_good", GOOD_MIN);
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
    let framing = if rtu { "rtu".to_owned() } else { format!("in-flight {}", random.within(1..=16)) };
    let settings = format!(
        "port plant tcp client {framing} sockets {sockets} timeout {}ms retries {} down-after {} \
             connect-timeout 500ms connect-delay {}ms request-delay {}ms idle {}
         port P502 tcp server 502 lifetime 5s
         {lines}
         route P502 * * * plant",
        random.within(30..=200),
        random.index(3),
        random.index(4),
        [0, 0, 20][random.index(3)],
        [0, 0, 5][random.index(3)],
        ["0", "1s", "60s"][random.index(3)],
    );
    with_gateway(seed, &settings, |world, rig| {
        // Of the board's, which may be fewer than the port's.
        let board = (!settings.contains("idle 0") && random.chance(0.3)).then(|| random.within(1..=5));
        board.into_iter().for_each(|board| rig.network.set_sockets(board as usize));
        let mut devices = HashMap::new();
        for n in 1..=count {
            let pair = [10 * n, 10 * n + 1].map(|unit| draw_device(&mut random, unit, rtu));
            rig.network.set_path(address(n), draw_path(&mut random));
            let at = address(n).to_string();
            match rtu {
                true => rig.attach_rtu_over_tcp(world, &at, pair.clone()),
                false => rig.attach_tcp(world, &at, pair.clone()),
            }
            devices.extend(pair.map(|device| (device.unit(), device)));
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
        let visitors: Vec<_> = (1..=random.within(1..=6) as u8)
            .map(|host| {
                let stream = rig.network.connect(machine(host), 502).expect("the gateway listens");
                let client = Client::new(stream).with_patience(Duration::from_secs(120));
                let (random, shifted, share) = (random.fork(), shifted.clone(), share.clone());
                world.spawn(Visitor { host, random, shifted, written: 0, share }.visit(client))
            })
            .collect();
        for visitor in visitors {
            world.run_until(visitor);
        }
        world.run_for(Duration::from_secs(60));
        assert_eq!(rig.frames_in_use(), 0, "frames that never came home");
        let most = rig.network.counters().sockets_most;
        assert!(most <= sockets.min(board.unwrap_or(u64::MAX)), "{most} sockets at a time");
        for device in devices.values() {
            let writes = device.writes();
            let once: std::collections::HashSet<&[u8]> = writes.iter().map(|write| &write.pdu[..]).collect();
            assert_eq!(once.len(), writes.len(), "a write was carried out twice: {writes:?}");
        }
    });
}

fn draw_device(random: &mut Random, unit: u8, rtu: bool) -> Device {
    let mut faults = Faults::new(random.bits());
    for _ in 0..random.index(3) {
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
        let fault = match random.index(12) {
            nth @ 0..8 => common[nth],
            8 if rtu => Fault::BadCrc,
            9 if rtu => Fault::NoiseBefore(3),
            8 => Fault::WrongTransaction,
            9 => Fault::Twice(Duration::from_millis(3)),
            10 => Fault::WrongFunction,
            _ => Fault::WrongLength,
        };
        faults = faults.with(When::Chance(random.index(30) as f64 / 100.0), fault);
    }
    let turnaround = Duration::from_micros(random.within(0..=20_000));
    Device::new(unit).with_fresh(FRESH).with_turnaround(turnaround).with_faults(faults)
}

fn draw_path(random: &mut Random) -> Path {
    Path {
        latency: Duration::from_micros(random.within(1..=3_000)),
        piece_bytes_max: [None, Some(1), Some(7)][random.index(3)],
        piece_spacing: Duration::from_micros(random.within(1..=100)),
        coalesce: Duration::from_micros(random.within(0..=2_000)),
        ..Path::default()
    }
}

struct Visitor {
    host: u8,
    random: Random,
    shifted: Vec<bool>,
    written: u8,
    share: Share,
}

impl Visitor {
    async fn visit(mut self, mut client: Client) {
        for _ in 0..self.random.within(1..=20) {
            Timer::after_micros(self.random.within(0..=50_000)).await;
            let burst = if self.random.chance(0.5) { self.random.within(2..=16) } else { 1 };
            let mut open = HashMap::new();
            for _ in 0..burst {
                let request = self.draw_request();
                let Some(id) = client.send(request.0, &request.2).await else { panic!("the gateway closed") };
                open.insert(id, (request, Instant::now()));
            }
            while !open.is_empty() {
                let reply = match client.receive().await {
                    Ok(reply) => reply,
                    Err(NoReply::Closed) => panic!("the gateway closed the connection"),
                    Err(NoReply::Silence) => panic!("no answer to {open:?}"),
                };
                let asked = open.remove(&reply.transaction);
                let ((unit, there, pdu), at) = asked.unwrap_or_else(|| panic!("nobody asked for {reply:?}"));
                assert_eq!((reply.unit, reply.protocol), (unit, 0));
                self.check(there, &pdu, at, &reply.pdu);
            }
        }
    }

    /// The unit, what its server calls it, and a request. Every seventh is for a unit that no server has.
    fn draw_request(&mut self) -> (u8, Option<u8>, Vec<u8>) {
        let server = self.random.index(self.shifted.len());
        let there = 10 * (server as u8 + 1) + self.random.byte() % 2;
        let unit = if self.shifted[server] { there + SHIFT } else { there };
        let (unit, there) = if self.random.chance(0.14) { (9, None) } else { (unit, Some(there)) };
        let address = self.random.byte() % 50;
        let pdu = match self.random.index(4) {
            0 | 1 => vec![3, 0, FRESH as u8, 0, Fresh::REGISTERS as u8],
            2 => vec![4, 0, address, 0, 1 + self.random.byte() % 40],
            _ => {
                // No two writes are alike.
                self.written += 1;
                vec![6, 1, address, self.host, self.written]
            }
        };
        (unit, there, pdu)
    }

    fn check(&self, there: Option<u8>, request: &[u8], asked: Instant, answer: &[u8]) {
        let tell = || format!("host {} asked {there:?} {request:02x?} at {asked}: {answer:02x?}", self.host);
        if let [function, code] = *answer
            && function & 0x80 != 0
        {
            assert!([0x06, 0x0a, 0x0b].contains(&code), "{}", tell());
            if there.is_some() {
                self.share.count(false);
            }
            return;
        }
        let Some(there) = there else { panic!("{}", tell()) };
        self.share.count(true);
        match *request {
            [3, ..] => {
                let fresh = Fresh::from_answer(answer).unwrap_or_else(|| panic!("{}", tell()));
                assert!(u64::from(fresh.at_us) >= asked.as_micros(), "stale: {}", tell());
            }
            [4, 0, address, 0, count] => {
                let values = (address..).take(count.into()).flat_map(|address| [!there, !address]);
                let expected: Vec<u8> = [4, 2 * count].into_iter().chain(values).collect();
                assert_eq!(*answer, expected, "{}", tell());
            }
            _ => assert_eq!(answer, request, "{}", tell()),
        }
    }
}
