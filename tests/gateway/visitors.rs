//! Clients of random worlds with TCP devices: they send bursts of requests, and look at every response.
//!
//! Each request gets exactly one response, it is the requester's own and of the unit that was asked, and its values are of now.

use std::collections::{HashMap, HashSet};

use embassy_time::{Duration, Instant, Timer};
use mobgate_simulator::client::NoResponse;
use mobgate_simulator::device::Fresh;
use mobgate_simulator::net::Path;
use mobgate_simulator::rig::{Rig, machine};
use mobgate_simulator::share::Share;
use mobgate_simulator::{Client, Device, Random, World};

/// The register of each device from which on it says what the time is.
pub(crate) const FRESH: u16 = 100;

/// The unit that a client asks, and the device that is to answer; none if there is none.
pub(crate) type Target = (u8, Option<u8>);

/// What the clients of a world do.
pub(crate) struct Visits<T> {
    /// Bursts of a client, at most.
    pub(crate) bursts: u64,
    /// Draws whom it asks.
    pub(crate) target: T,
    /// The exceptions that it may get.
    pub(crate) exceptions: &'static [u8],
}

impl<T: Fn(&mut Random) -> Target + Clone + 'static> Visits<T> {
    /// Lets some clients visit the gateway until they have done, and the world settle.
    pub(crate) fn run<'w>(self, world: &mut World<'w>, rig: &Rig<'w>, random: &mut Random, share: &Share) {
        let visitors: Vec<_> = (1..=random.within(1..=6) as u8)
            .map(|host| {
                let stream = rig.network.connect(machine(host), 502).expect("the gateway listens");
                let client = Client::new(stream).with_patience(Duration::from_secs(120));
                let Self { bursts, ref target, exceptions } = self;
                let visits = Visits { bursts, target: target.clone(), exceptions };
                let random = random.fork();
                world.spawn(Visitor { visits, host, random, written: 0, share: share.clone() }.visit(client))
            })
            .collect();
        for visitor in visitors {
            world.run_until(visitor);
        }
        world.run_for(Duration::from_secs(60));
        assert_eq!(rig.frames_in_use(), 0, "frames that never came home");
    }
}

/// Sees to it that `device` was written nothing twice: no two writes of the clients are alike.
pub(crate) fn wrote_once(device: &Device) {
    let writes = device.writes();
    let once: HashSet<&[u8]> = writes.iter().map(|write| &write.pdu[..]).collect();
    assert_eq!(once.len(), writes.len(), "a write was carried out twice: {writes:?}");
}

/// A way to a server.
pub(crate) fn draw_path(random: &mut Random) -> Path {
    Path {
        latency: Duration::from_micros(random.within(1..=3_000)),
        piece_bytes_max: [None, Some(1), Some(7)][random.index(3)],
        piece_spacing: Duration::from_micros(random.within(1..=100)),
        coalesce: Duration::from_micros(random.within(0..=2_000)),
        ..Path::default()
    }
}

struct Visitor<T> {
    visits: Visits<T>,
    host: u8,
    random: Random,
    written: u8,
    share: Share,
}

impl<T: Fn(&mut Random) -> Target> Visitor<T> {
    async fn visit(mut self, mut client: Client) {
        for _ in 0..self.random.within(1..=self.visits.bursts) {
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
                    Err(NoResponse::Closed) => panic!("the gateway closed the connection"),
                    Err(NoResponse::Silence) => panic!("no answer to {open:?}"),
                };
                let asked = open.remove(&reply.transaction);
                let ((unit, device, pdu), at) = asked.unwrap_or_else(|| panic!("nobody asked for {reply:?}"));
                assert_eq!((reply.unit, reply.protocol), (unit, 0));
                self.check(device, &pdu, at, &reply.pdu);
            }
        }
    }

    /// Whom it asks, and for what.
    fn draw_request(&mut self) -> (u8, Option<u8>, Vec<u8>) {
        let (unit, device) = (self.visits.target)(&mut self.random);
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
        (unit, device, pdu)
    }

    fn check(&self, device: Option<u8>, request: &[u8], asked: Instant, answer: &[u8]) {
        let tell = || format!("host {} asked {device:?} {request:02x?} at {asked}: {answer:02x?}", self.host);
        if let [function, code] = *answer
            && function & 0x80 != 0
        {
            assert!(self.visits.exceptions.contains(&code), "{}", tell());
            if device.is_some() {
                self.share.count(false);
            }
            return;
        }
        let Some(device) = device else { panic!("{}", tell()) };
        self.share.count(true);
        match *request {
            [3, ..] => {
                let fresh = Fresh::from_response(answer).unwrap_or_else(|| panic!("{}", tell()));
                assert!(u64::from(fresh.at_us) >= asked.as_micros(), "stale: {}", tell());
            }
            [4, 0, address, 0, count] => {
                let values = (address..).take(count.into()).flat_map(|address| [!device, !address]);
                let expected: Vec<u8> = [4, 2 * count].into_iter().chain(values).collect();
                assert_eq!(*answer, expected, "{}", tell());
            }
            _ => assert_eq!(answer, request, "{}", tell()),
        }
    }
}
