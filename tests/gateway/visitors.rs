//! Clients of random worlds: they send bursts of requests, and look at every response.
//!
//! Each request gets exactly one response, it is the requester's own and of the unit that was asked, and its values are of now.

use std::collections::{HashMap, HashSet};

use embassy_time::{Duration, Instant, Timer};
use mobgate_simulator::client::NoResponse;
use mobgate_simulator::device::Fresh;
use mobgate_simulator::rig::{Rig, machine};
use mobgate_simulator::torture::{FRESH, Share, draw_path};
use mobgate_simulator::{Client, Device, Random, World};

/// The unit that a client asks, and what may come of that.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Target {
    pub(crate) unit: u8,
    /// The device that is to answer; none if there is none.
    pub(crate) device: Option<u8>,
    /// The exceptions that a read may get, and a write.
    pub(crate) exceptions: [&'static [u8]; 2],
    /// Everybody reads the same.
    pub(crate) herd: bool,
    /// How old values may be.
    pub(crate) age: Duration,
}

impl Target {
    /// A unit, and the device that is to answer.
    pub(crate) fn new(unit: u8, device: Option<u8>, exceptions: &'static [u8]) -> Self {
        Self { unit, device, exceptions: [exceptions; 2], herd: false, age: Duration::from_ticks(0) }
    }
}

/// What the clients of a world do.
#[derive(Clone)]
pub(crate) struct Visits<T> {
    /// Clients, at most.
    pub(crate) clients: u64,
    /// Bursts of a client, at most.
    pub(crate) bursts: u64,
    /// Whether they leave without a word, and the gateway may close.
    pub(crate) parts: bool,
    /// Draws whom it asks on this port.
    pub(crate) target: T,
}

impl<T: Fn(&mut Random, u16) -> Target + Clone + 'static> Visits<T> {
    /// Lets some clients visit the gateway on these `ports` until they have done, and the world settle.
    pub(crate) fn run<'w>(
        self,
        world: &mut World<'w>,
        rig: &Rig<'w>,
        ports: &[u16],
        random: &mut Random,
        share: &Share,
    ) {
        let visitors: Vec<_> = (1..=random.within(1..=self.clients) as u8)
            .map(|host| {
                let port = ports[random.index(ports.len())];
                let path = draw_path(random);
                let stream =
                    rig.network.connect_over(path, machine(host), port).expect("the gateway listens");
                let client = Client::new(stream).with_patience(Duration::from_secs(120));
                let (visits, random, share) = (self.clone(), random.fork(), share.clone());
                world.spawn(Visitor { visits, host, port, random, written: 0, share }.visit(client))
            })
            .collect();
        for visitor in visitors {
            world.run_until(visitor);
        }
        // Late responses, and requests whose requesters have gone.
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

struct Visitor<T> {
    visits: Visits<T>,
    host: u8,
    port: u16,
    random: Random,
    written: u8,
    share: Share,
}

impl<T: Fn(&mut Random, u16) -> Target> Visitor<T> {
    async fn visit(mut self, mut client: Client) {
        for _ in 0..self.random.within(1..=self.visits.bursts) {
            Timer::after_micros(self.random.within(0..=50_000)).await;
            let burst = if self.random.chance(0.4) { self.random.within(2..=20) } else { 1 };
            let mut open = HashMap::new();
            for _ in 0..burst {
                let (target, pdu) = self.draw_request();
                let Some(id) = client.send(target.unit, &pdu).await else { return self.is_closed() };
                assert!(open.insert(id, (target, pdu, Instant::now())).is_none());
            }
            if self.visits.parts && self.random.chance(0.03) {
                return;
            }
            while !open.is_empty() {
                let reply = match client.receive().await {
                    Ok(reply) => reply,
                    Err(NoResponse::Closed) => return self.is_closed(),
                    Err(NoResponse::Silence) => panic!("no answer to {open:?}"),
                };
                let asked = open.remove(&reply.transaction);
                let (target, pdu, at) = asked.unwrap_or_else(|| panic!("nobody asked for {reply:?}"));
                assert_eq!((reply.unit, reply.protocol), (target.unit, 0));
                self.check(&target, &pdu, at, &reply.pdu);
            }
        }
    }

    /// Crowded out, or idle for too long.
    fn is_closed(&self) {
        assert!(self.visits.parts, "the gateway closed the connection");
    }

    /// Whom it asks, and for what.
    fn draw_request(&mut self) -> (Target, Vec<u8>) {
        let target = (self.visits.target)(&mut self.random, self.port);
        let fresh = vec![3, 0, FRESH as u8, 0, Fresh::REGISTERS as u8];
        let address = self.random.byte() % 51;
        let pdu = match self.random.index(6) {
            _ if target.herd => fresh,
            0 | 1 => fresh,
            2 | 3 => vec![[3, 4][self.random.index(2)], 0, address, 0, 1 + self.random.byte() % 40],
            nth => {
                // No two writes are alike.
                self.written += 1;
                let (host, written) = (self.host, self.written);
                if nth == 4 {
                    vec![6, 1, address, host, written]
                } else {
                    vec![16, 2, address, 0, 1, 2, host, written]
                }
            }
        };
        (target, pdu)
    }

    /// Whether `answer` is one that `request` may get.
    fn check(&self, target: &Target, request: &[u8], asked: Instant, answer: &[u8]) {
        let tell = || format!("host {} asked {target:?} {request:02x?} at {asked}: {answer:02x?}", self.host);
        if let [function, code] = *answer
            && function & 0x80 != 0
        {
            let expected = target.exceptions[usize::from(request[0] > 4)];
            assert!(expected.contains(&code), "{}", tell());
            if target.device.is_some() {
                self.share.count(false);
            }
            return;
        }
        let Some(device) = target.device else { panic!("{}", tell()) };
        self.share.count(true);
        match *request {
            [3, 0, address, ..] if u16::from(address) == FRESH => {
                let fresh = Fresh::from_response(answer).unwrap_or_else(|| panic!("{}", tell()));
                assert!(
                    u64::from(fresh.at_us) + target.age.as_micros() >= asked.as_micros(),
                    "stale: {}",
                    tell()
                );
            }
            [function @ (3 | 4), 0, address, 0, count] => {
                // Input registers hold the complement of what holding registers hold.
                let mask = if function == 4 { 0xff } else { 0 };
                let values =
                    (address..).take(count.into()).flat_map(|address| [device ^ mask, address ^ mask]);
                let expected: Vec<u8> = [function, 2 * count].into_iter().chain(values).collect();
                assert_eq!(*answer, expected, "{}", tell());
            }
            _ => assert_eq!(*answer, request[..5], "{}", tell()),
        }
    }
}
