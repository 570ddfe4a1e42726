//! Clients of random worlds: they send bursts of requests, and look at every response.
//!
//! Each request gets exactly one response, it is the requester's own and of the unit that was asked, and its values are of now.

use std::collections::HashSet;

use mobgate_simulator::client::NoResponse;

use crate::prelude::*;

/// The register of each device from which on it says what the time is.
pub(crate) const FRESH: u16 = 100;

/// What a client asks.
#[derive(Debug)]
pub(crate) struct Request {
    pub(crate) unit: u8,
    /// Who is to respond; none if there is none.
    pub(crate) device: Option<u8>,
    pub(crate) pdu: Vec<u8>,
}

/// A client of a random world.
pub(crate) trait Visitor: Sized {
    /// How many bursts it sends at most; how likely one has more than one request, and how many those are at most.
    fn bursts(&self) -> (u64, f64, u64);
    fn random(&mut self) -> &mut Random;
    fn draw_request(&mut self) -> Request;

    /// Whether it goes now without a word.
    fn leaves(&mut self) -> bool {
        false
    }

    /// The connection has ended.
    fn closed(&self) {
        panic!("the gateway closed the connection");
    }

    /// Sees to it that `response` is one that `request` may get.
    fn check(&self, request: &Request, asked: Instant, response: &[u8]);

    async fn visit(mut self, mut client: Client) {
        let (bursts, chance, most) = self.bursts();
        for _ in 0..self.random().within(1..=bursts) {
            Timer::after_micros(self.random().within(0..=50_000)).await;
            let burst = if self.random().chance(chance) { self.random().within(2..=most) } else { 1 };
            let mut open = HashMap::new();
            for _ in 0..burst {
                let request = self.draw_request();
                let Some(id) = client.send(request.unit, &request.pdu).await else { return self.closed() };
                assert!(open.insert(id, (request, Instant::now())).is_none());
            }
            if self.leaves() {
                return;
            }
            while !open.is_empty() {
                let reply = match client.receive().await {
                    Ok(reply) => reply,
                    Err(NoResponse::Closed) => return self.closed(),
                    Err(NoResponse::Silence) => panic!("no response to {open:?}"),
                };
                let asked = open.remove(&reply.transaction);
                let (request, at) = asked.unwrap_or_else(|| panic!("nobody asked for {reply:?}"));
                assert_eq!((reply.unit, reply.protocol), (request.unit, 0));
                self.check(&request, at, &reply.pdu);
            }
        }
    }
}

/// The code of an exception.
pub(crate) fn exception(response: &[u8]) -> Option<u8> {
    match *response {
        [function, code] if function & 0x80 != 0 => Some(code),
        _ => None,
    }
}

/// Sees to it that `response` is the good one of `device` to `request`, read when that was `asked` or up to `age_ms` before.
pub(crate) fn assert_good(
    request: &[u8],
    device: u8,
    (asked, age_ms): (Instant, u64),
    response: &[u8],
    tell: impl Fn() -> String,
) {
    match *request {
        [3, 0, 100, 0, 4] => {
            let fresh = Fresh::from_response(response).unwrap_or_else(|| panic!("{}", tell()));
            assert!(u64::from(fresh.at_us) + 1_000 * age_ms >= asked.as_micros(), "stale: {}", tell());
        }
        [function @ (3 | 4), 0, address, 0, count] => {
            // Input registers hold the complement of what holding registers hold.
            let mask = if function == 4 { 0xff } else { 0 };
            let values = (address..).take(count.into()).flat_map(|address| [device ^ mask, address ^ mask]);
            let expected: Vec<u8> = [function, 2 * count].into_iter().chain(values).collect();
            assert_eq!(*response, expected, "{}", tell());
        }
        _ => assert_eq!(response, &request[..5], "{}", tell()),
    }
}

/// The unit that a client asks, and the device that is to respond; none if there is none.
pub(crate) type Target = (u8, Option<u8>);

/// What the clients of a world with TCP devices do.
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
                world.spawn(Asker { visits, host, random, written: 0, share: share.clone() }.visit(client))
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

/// Words of a TCP client.
pub(crate) fn draw_words(random: &mut Random, rtu: bool) -> String {
    let framing = if rtu { "rtu".to_owned() } else { format!("in-flight {}", random.within(1..=16)) };
    format!(
        "{framing} timeout {}ms retries {} down-after {} connect-timeout 500ms connect-delay {}ms request-delay {}ms idle {}",
        random.within(30..=200),
        random.index(3),
        random.index(4),
        [0, 0, 20][random.index(3)],
        [0, 0, 5][random.index(3)],
        ["0", "1s", "60s"][random.index(3)],
    )
}

/// A path with so much latency, and time between two pieces, at most.
pub(crate) fn draw_path(random: &mut Random, latency_us: u64, spacing_us: u64) -> Path {
    Path {
        latency: Duration::from_micros(random.within(1..=latency_us)),
        piece_bytes_max: [None, Some(1), Some(7)][random.index(3)],
        piece_spacing: Duration::from_micros(random.within(1..=spacing_us)),
        coalesce: Duration::from_micros(random.within(0..=2_000)),
        ..Path::default()
    }
}

/// A device with fewer faults than `count`, each at less than `percent` of the requests.
pub(crate) fn draw_device(
    random: &mut Random,
    unit: u8,
    (count, percent): (usize, usize),
    fault: impl Fn(&mut Random) -> Fault,
) -> Device {
    let mut faults = Faults::new(random.bits());
    for _ in 0..random.index(count) {
        let fault = fault(random);
        faults = faults.with(When::Chance(random.index(percent) as f64 / 100.0), fault);
    }
    // Many devices refuse diagnostics.
    if random.chance(0.3) {
        faults = faults.with(When::Function(8), Fault::Exception(1));
    }
    let turnaround = Duration::from_micros(random.within(0..=20_000));
    Device::new(unit).with_fresh(FRESH).with_turnaround(turnaround).with_faults(faults)
}

struct Asker<T> {
    visits: Visits<T>,
    host: u8,
    random: Random,
    written: u8,
    share: Share,
}

impl<T: Fn(&mut Random) -> Target> Visitor for Asker<T> {
    fn bursts(&self) -> (u64, f64, u64) {
        (self.visits.bursts, 0.5, 16)
    }

    fn random(&mut self) -> &mut Random {
        &mut self.random
    }

    fn draw_request(&mut self) -> Request {
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
        Request { unit, device, pdu }
    }

    fn check(&self, request: &Request, asked: Instant, response: &[u8]) {
        let tell = || format!("host {} asked {request:02x?} at {asked}: {response:02x?}", self.host);
        let code = exception(response);
        if request.device.is_some() {
            self.share.count(code.is_none());
        }
        if let Some(code) = code {
            return assert!(self.visits.exceptions.contains(&code), "{}", tell());
        }
        let Some(device) = request.device else { panic!("{}", tell()) };
        assert_good(&request.pdu, device, (asked, 0), response, tell);
    }
}
