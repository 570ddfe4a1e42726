//! Random worlds: lines, devices with faults, clients that misbehave, all drawn from a seed.
//!
//! Whatever happens, every request gets exactly one response, it is the requester's own, its values are of now, every frame is
//! back in the pool at the end, and the gateway never speaks before the line was silent for t3.5.

use crate::prelude::*;
use crate::visitors::{FRESH, Request, Visitor, assert_good, draw_device, draw_path, exception};

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
const CACHE_MS: u64 = 200;

#[test]
fn random_worlds_keep_the_promises() {
    each_world(SEEDS, "torture_good", GOOD_MIN, live);
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
         route P503 101-106 * -{TAG} B cache {CACHE_MS}ms {merge}
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
    );
    with_gateway(seed, &settings, |world, rig| {
        for line in ["a", "b"] {
            connect_devices(world, rig, line, &mut random);
        }
        let clients = random.within(1..=10) as u8;
        let done: Vec<_> = (1..=clients)
            .map(|host| {
                let port = [502, 503][random.index(2)];
                let path = draw_path(&mut random, 5_000, 500);
                let stream =
                    rig.network.connect_over(path, machine(host), port).expect("the gateway listens");
                let visitor = Asker { host, port, herd, random: random.fork(), share: share.clone() };
                world.spawn(visitor.visit(Client::new(stream).with_patience(Duration::from_secs(120))))
            })
            .collect();
        for task in done {
            world.run_until(task);
        }
        // Late responses, and requests whose requesters have gone.
        world.run_for(Duration::from_secs(60));
        assert_eq!(rig.frames_in_use(), 0, "frames that never came home");
        for line in ["a", "b"] {
            let end = (rig.end(line), Framing::Rtu);
            let hasty = rig.wire(line).hasty_frames(end, Duration::from_ticks(0), Duration::from_ticks(0));
            assert_eq!(hasty, [], "line {line}");
        }
    });
}

fn connect_devices<'w>(world: &World<'w>, rig: &Rig<'w>, line: &str, random: &mut Random) {
    let strays = random.chance(0.25);
    let devices: Vec<Device> = (1..=DEVICES)
        .map(|unit| draw_device(random, unit, (3, 40), |random| draw_fault(random, strays)))
        .collect();
    rig.attach(world, line, devices);
}

/// One that may happen on a line; responses go astray there, or are late without a bound. A stray one is the late one of another for
/// all that anybody can tell: of devices that the gateway may rely on, none sends a second response in another's name.
fn draw_fault(random: &mut Random, strays: bool) -> Fault {
    let pause = Duration::from_micros(random.within(2_000..=20_000));
    let late = if strays { Fault::WrongUnit } else { Fault::draw_late(random) };
    let frames = [Fault::Dead, Fault::Unheard, late, late, late, late];
    let noise = [Fault::NoiseBefore(3), Fault::NoiseAfter(3), Fault::GapInside(pause), Fault::Exception(6)];
    let faults = [&frames[..], &Fault::CORRUPTING, &Fault::MISFITS, &[Fault::WrongEcho], &noise].concat();
    faults[random.index(faults.len())]
}

/// A client, which asks for a while and may leave without a word.
struct Asker {
    host: u8,
    port: u16,
    /// The unit that everybody asks for the same.
    herd: Option<u8>,
    random: Random,
    share: Share,
}

impl Visitor for Asker {
    fn bursts(&self) -> (u64, f64, u64) {
        (30, 0.3, 20)
    }

    fn random(&mut self) -> &mut Random {
        &mut self.random
    }

    fn leaves(&mut self) -> bool {
        self.random.chance(0.03)
    }

    fn closed(&self) {
        // It was crowded out, or idle for too long.
    }

    fn draw_request(&mut self) -> Request {
        let fresh = vec![3, 0, FRESH as u8, 0, Fresh::REGISTERS as u8];
        let tag = [0, TAG][self.random.index(2)];
        if let (Some(unit), true) = (self.herd, self.random.chance(0.7)) {
            return Request { unit: unit + tag, device: Some(unit), pdu: fresh };
        }
        let unit = self.random.within(1..=u64::from(DEVICES) + 3) as u8;
        let address = self.random.within(0..=50) as u16;
        let count = self.random.within(1..=40) as u16;
        let [high, low] = address.to_be_bytes();
        let pdu = match self.random.index(6) {
            0 | 5 => fresh,
            1 | 2 => vec![[3, 4][self.random.index(2)], high, low, 0, count as u8],
            3 => vec![6, 1, low, self.random.byte(), self.random.byte()],
            _ => vec![16, 2, low, 0, 1, 2, self.random.byte(), self.random.byte()],
        };
        Request { unit: unit + tag, device: Some(unit).filter(|unit| *unit <= DEVICES), pdu }
    }

    fn check(&self, request: &Request, asked: Instant, response: &[u8]) {
        let tell = || format!("host {} asked {request:?} at {asked}: {response:?}", self.host);
        let routed = (1..=6).contains(&(request.unit % TAG)) && (self.port == 502 || self.host < 16);
        let code = exception(response);
        if routed && request.device.is_some() {
            self.share.count(code.is_none());
        }
        if let Some(code) = code {
            // 05 to 06 of unit 5 and 6 are refused on port 502: those are read-only there.
            let refused =
                self.port == 502 && request.unit < TAG && request.device.is_none() && request.pdu[0] > 4;
            let expected: &[u8] = match (routed, refused) {
                (false, _) => &[0x06, 0x0a],
                (true, true) => &[0x06, 0x01],
                // The device says busy, or the fault on top of it turns a bit of that.
                (true, false) => &[0x06, 0x07, 0x0b],
            };
            return assert!(expected.contains(&code), "{}", tell());
        }
        let Some(device) = request.device.filter(|_| routed) else { panic!("{}", tell()) };
        let kept = self.port == 503 && request.unit >= TAG;
        assert_good(&request.pdu, device, (asked, if kept { CACHE_MS } else { 0 }), response, tell);
    }
}
