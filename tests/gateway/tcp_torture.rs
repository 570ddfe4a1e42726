//! Random TCP devices with faults, behind a TCP client with random settings, drawn from a seed.
//!
//! Whatever happens, every request gets exactly one answer, it is the asker's own, its values are of now, no write is
//! carried out twice, and every frame is back in the pool at the end.
//!
//! `MOBGATE_SEED=17 cargo test tcp_torture` runs the world of seed 17 alone; `MOBGATE_SEEDS=4000` runs so many, as CI does.

use std::collections::{HashMap, HashSet};

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
const SEEDS: u64 = 300;
/// Of all answers that the devices could give, in per cent.
const GOOD_MIN: f64 = 35.0;
const SERVER: &str = "10.0.1.1:502";
const FRESH: u16 = 100;
const DEVICES: u8 = 4;

#[test]
fn random_tcp_devices_keep_no_answer_from_its_asker() {
    let share = Share::default();
    each_seed(SEEDS, |seed| live(seed, &share));
    share.demand("tcp_torture_good", GOOD_MIN);
}

fn live(seed: u64, share: &Share) {
    let mut random = Random::new(seed);
    let rtu = random.chance(0.3);
    let framing = if rtu { "rtu".to_owned() } else { format!("in-flight {}", random.within(1..=16)) };
    let settings = format!(
        "port plc tcp client {SERVER} {framing} timeout {}ms retries {} down-after {} connect-timeout 500ms \
             connect-delay {}ms request-delay {}ms idle {}
         port P502 tcp server 502 lifetime 5s
         route P502 * * * plc",
        random.within(30..=200),
        random.index(3),
        random.index(4),
        [0, 0, 20][random.index(3)],
        [0, 0, 5][random.index(3)],
        ["0", "1s", "60s"][random.index(3)],
    );
    with_gateway(seed, &settings, |world, rig| {
        let strays = random.chance(0.25);
        let devices: Vec<Device> =
            (1..=DEVICES).map(|unit| draw_device(&mut random, unit, rtu, strays)).collect();
        rig.network.set_path(SERVER.parse().unwrap(), draw_path(&mut random));
        match rtu {
            true => rig.attach_rtu_over_tcp(world, SERVER, devices.clone()),
            false => rig.attach_tcp(world, SERVER, devices.clone()),
        }
        let visitors: Vec<_> = (1..=random.within(1..=6) as u8)
            .map(|host| {
                let stream = rig.network.connect(machine(host), 502).expect("the gateway listens");
                let client = Client::new(stream).with_patience(Duration::from_secs(120));
                world.spawn(
                    Visitor { host, random: random.fork(), written: 0, share: share.clone() }.visit(client),
                )
            })
            .collect();
        for visitor in visitors {
            world.run_until(visitor);
        }
        world.run_for(Duration::from_secs(60));
        assert_eq!(rig.frames_in_use(), 0, "frames that never came home");
        for device in devices {
            let writes = device.writes();
            let once: HashSet<&[u8]> = writes.iter().map(|write| &write.pdu[..]).collect();
            assert_eq!(once.len(), writes.len(), "a write was carried out twice: {writes:?}");
        }
    });
}

/// By RTU, answers go astray or are late without a bound: a stray one is the late one of another for all that anybody can tell.
fn draw_device(random: &mut Random, unit: u8, rtu: bool, strays: bool) -> Device {
    let mut faults = Faults::new(random.bits());
    for _ in 0..random.index(4) {
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
        // MBAP has no checksum: what is damaged there, TCP has let through, and nobody can tell.
        let only = match rtu {
            true => [
                Fault::BadCrc,
                Fault::FlippedBit,
                Fault::LostByte,
                Fault::NoiseBefore(3),
                Fault::NoiseAfter(3),
            ],
            false => [
                Fault::WrongTransaction,
                Fault::WrongUnit,
                Fault::Half,
                Fault::Twice(Duration::from_millis(3)),
                late,
            ],
        };
        let faults_all = [&common[..], &only[..]].concat();
        let fault = faults_all[random.index(faults_all.len())];
        faults = faults.with(When::Chance(random.index(30) as f64 / 100.0), fault);
    }
    // Many devices refuse diagnostics.
    if random.chance(0.3) {
        faults = faults.with(When::Function(8), Fault::Exception(1));
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
    written: u8,
    share: Share,
}

impl Visitor {
    async fn visit(mut self, mut client: Client) {
        for _ in 0..self.random.within(1..=30) {
            Timer::after_micros(self.random.within(0..=50_000)).await;
            let burst = if self.random.chance(0.5) { self.random.within(2..=16) } else { 1 };
            let mut open = HashMap::new();
            for _ in 0..burst {
                let (unit, pdu) = self.draw_request();
                let Some(id) = client.send(unit, &pdu).await else { panic!("the gateway closed") };
                open.insert(id, (unit, pdu, Instant::now()));
            }
            while !open.is_empty() {
                let reply = match client.receive().await {
                    Ok(reply) => reply,
                    Err(NoReply::Closed) => panic!("the gateway closed the connection"),
                    Err(NoReply::Silence) => panic!("no answer to {open:?}"),
                };
                let asked = open.remove(&reply.transaction);
                let (unit, pdu, at) = asked.unwrap_or_else(|| panic!("nobody asked for {reply:?}"));
                assert_eq!((reply.unit, reply.protocol), (unit, 0));
                self.check(unit, &pdu, at, &reply.pdu);
            }
        }
    }

    fn draw_request(&mut self) -> (u8, Vec<u8>) {
        let unit = self.random.within(1..=u64::from(DEVICES) + 1) as u8;
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
        (unit, pdu)
    }

    fn check(&self, unit: u8, request: &[u8], asked: Instant, answer: &[u8]) {
        let tell =
            || format!("host {} asked unit {unit} {request:02x?} at {asked}: {answer:02x?}", self.host);
        if let [function, code] = *answer
            && function & 0x80 != 0
        {
            // Of the device with a bit turned: 06 and 07.
            assert!([0x06, 0x07, 0x0a, 0x0b].contains(&code), "{}", tell());
            if unit <= DEVICES {
                self.share.count(false);
            }
            return;
        }
        assert!(unit <= DEVICES, "{}", tell());
        self.share.count(true);
        match *request {
            [3, ..] => {
                let fresh = Fresh::from_answer(answer).unwrap_or_else(|| panic!("{}", tell()));
                assert!(u64::from(fresh.at_us) >= asked.as_micros(), "stale: {}", tell());
            }
            [4, 0, address, 0, count] => {
                let values = (address..).take(count.into()).flat_map(|address| [!unit, !address]);
                let expected: Vec<u8> = [4, 2 * count].into_iter().chain(values).collect();
                assert_eq!(*answer, expected, "{}", tell());
            }
            _ => assert_eq!(answer, request, "{}", tell()),
        }
    }
}
