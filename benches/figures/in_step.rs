//! Devices that respond in order, but however late: how many responses were not the response to their request, and how many good ones
//! there are beside those of an ideal client, whose requests would have transaction numbers.
//!
//! The ideal client is computed and not simulated: on the same line it asks the same kind of device, whose faults have the same
//! chances, and knows each response as soon as it comes. Nobody else's response costs it anything.

use mobgate::stats::Event;
use mobgate_simulator::console::typed;
use mobgate_simulator::device::Fresh;
use mobgate_simulator::random::chosen;
use mobgate_simulator::world::Task;

use crate::prelude::*;

const TRANSACTIONS: u64 = 1_000_000;
const TIMEOUT: Duration = Duration::from_millis(100);
const TURNAROUND: Duration = Duration::from_millis(5);
/// How long a world lasts.
const LENGTH: Duration = Duration::from_secs(600);
/// Where the devices have registers that differ at every read.
const FRESH: u16 = 100;
const SERVER: &str = "10.0.1.1:502";
/// What a client does after an exception, lest it asks for ever in no time at all.
const PAUSE: Duration = Duration::from_millis(5);

/// What a device does with function 8.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Diagnostics {
    Known,
    Refused,
    Ignored,
}

/// How frames travel between the gateway and the device.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Wire {
    Rtu,
    Ascii,
    RtuOverTcp,
}

/// What happens in a world.
#[derive(Debug)]
struct Plan {
    seed: u64,
    wire: Wire,
    diagnostics: Diagnostics,
    clients: u8,
    /// All clients ask for the same registers, and for nothing else.
    equal: bool,
    merge: bool,
    /// A master on another line, whose frames are passed on while they arrive.
    cut: bool,
    retries: u8,
    late: (f64, Duration),
    hiccup: (f64, Duration),
    unheard: f64,
    dead: f64,
    exception: f64,
}

#[derive(Default)]
struct Sum {
    transactions: u64,
    good: u64,
    wrong: u64,
    /// Of the worlds that are compared.
    compared: f64,
    ideal: f64,
}

impl Plan {
    fn draw(seed: u64) -> Self {
        let mut random = Random::new(seed);
        let wire = [Wire::Rtu, Wire::Rtu, Wire::Ascii, Wire::RtuOverTcp][random.index(4)];
        let mean_of_ten = TIMEOUT * random.within(2..=100) as u32;
        Self {
            seed,
            wire,
            diagnostics: [Diagnostics::Known, Diagnostics::Refused, Diagnostics::Ignored][random.index(3)],
            clients: [1, 2, 8][random.index(3)],
            equal: random.chance(0.5),
            merge: random.chance(0.3),
            cut: wire != Wire::RtuOverTcp && random.chance(0.3),
            retries: 2 * random.index(2) as u8,
            late: (random.within(1..=10) as f64 / 200.0, mean_of_ten / 10),
            hiccup: (random.index(5) as f64 / 2_000.0, TIMEOUT * random.within(2..=50) as u32),
            unheard: random.index(3) as f64 / 100.0,
            dead: random.index(3) as f64 / 100.0,
            exception: random.index(3) as f64 / 100.0,
        }
    }

    /// Whether every transaction is asked for by one client and nothing but its response counts.
    fn is_compared(&self) -> bool {
        !self.merge && !self.cut
    }

    /// Whether only time can prove that such a device is in step.
    fn is_unproven(&self) -> bool {
        self.equal && self.diagnostics == Diagnostics::Ignored
    }

    fn settings(&self) -> String {
        let (retries, timeout) = (self.retries, TIMEOUT.as_millis());
        let merge = if self.merge { "" } else { "merge off" };
        let port = match self.wire {
            Wire::Rtu => "serial bus rtu client 19200 8E1".to_owned(),
            Wire::Ascii => "serial bus ascii client 19200 8E1".to_owned(),
            Wire::RtuOverTcp => format!("tcp client {SERVER} rtu idle 0"),
        };
        format!(
            "port bus {port} timeout {timeout}ms retries {retries}
             port up serial up rtu server 19200 8E1
             port P502 tcp server 502 lifetime 60s
             route P502 1-247 * * bus {merge}
             route up 1-247 * * bus {merge} cut on
            "
        )
    }

    fn device(&self) -> Device {
        let faults = Faults::new(self.seed)
            .with(When::Chance(self.late.0), Fault::Lingers(self.late.1))
            .with(When::Chance(self.hiccup.0), Fault::Hiccup(Duration::from_millis(1), self.hiccup.1))
            .with(When::Chance(self.unheard), Fault::Unheard)
            .with(When::Chance(self.dead), Fault::Dead)
            .with(When::Chance(self.exception / 2.0), Fault::Exception(2))
            .with(When::Chance(self.exception / 2.0), Fault::Exception(0x0b));
        let faults = match self.diagnostics {
            Diagnostics::Known => faults,
            Diagnostics::Refused => faults.with(When::Function(8), Fault::Exception(1)),
            Diagnostics::Ignored => faults.with(When::Function(8), Fault::Unheard),
        };
        Device::new(1).with_fresh(FRESH).with_turnaround(TURNAROUND).with_faults(faults)
    }

    /// The good responses of an ideal client that asks for the same time.
    fn ideal(&self) -> f64 {
        let mut random = Random::new(self.seed ^ 0x5eed);
        let (char_s, gap_s) = match self.wire {
            Wire::RtuOverTcp => (0.0, 0.0),
            _ => (11.0 / 19_200.0, 3.5 * 11.0 / 19_200.0),
        };
        let chars = |bytes: f64| if self.wire == Wire::Ascii { 2.0 * bytes + 1.0 } else { bytes };
        let seconds = |duration: Duration| duration.as_micros() as f64 / 1e6;
        let until =
            |random: &mut Random, most: Duration| seconds(most) * random.within(0..=1_000) as f64 / 1e3;
        let (mut now, mut free, mut stalled, mut good) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0);
        while now < seconds(LENGTH) {
            // Eight bytes of FC 3, and 7 to 13 of its response.
            let response = if self.equal { 13.0 } else { 9.0 };
            let sent = now + chars(8.0) * char_s;
            let heard = sent + if self.wire == Wire::Rtu { gap_s } else { 0.0 };
            let timeout = sent + seconds(TIMEOUT);
            now = timeout;
            if random.chance(self.unheard) {
                continue;
            }
            if random.chance(self.hiccup.0) {
                stalled = stalled.max(heard + until(&mut random, self.hiccup.1));
            }
            let late = random.chance(self.late.0);
            let lateness = if late { seconds(self.late.1) * random.exponential() } else { 0.0 };
            let begins = (heard + seconds(TURNAROUND) + lateness).max(stalled).max(free);
            let ends = begins + chars(response) * char_s;
            free = ends + gap_s;
            if random.chance(self.dead) {
                continue;
            }
            if begins <= timeout {
                now = ends + gap_s;
                good += f64::from(u8::from(!random.chance(self.exception)));
            }
        }
        good
    }
}

pub(crate) fn figures() {
    let (mut proven, mut unproven) = (Sum::default(), Sum::default());
    for seed in chosen("MOBGATE_SEED").unwrap_or(1).. {
        let plan = Plan::draw(seed);
        live(&plan, if plan.is_unproven() { &mut unproven } else { &mut proven });
        if proven.transactions >= TRANSACTIONS {
            break;
        }
    }
    for (name, sum, least) in [("in_step", proven, 0.9), ("unproven", unproven, 0.0)] {
        let transactions = sum.transactions as f64;
        let wanted = if least > 0.0 { Target::AtLeast(TRANSACTIONS as f64) } else { Target::None };
        figure(&format!("{name}_transactions"), transactions, "requests", wanted);
        let wrong = if least > 0.0 { Target::AtMost(0.0) } else { Target::None };
        figure(&format!("{name}_wrong"), sum.wrong as f64, "responses", wrong);
        let hours = |good: f64| good / (LENGTH.as_secs() as f64 / 3_600.0);
        figure(&format!("{name}_good_per_hour"), hours(sum.compared), "responses", Target::None);
        let bound = if least > 0.0 { Target::AtLeast(least) } else { Target::None };
        figure(&format!("{name}_over_ideal"), sum.compared / sum.ideal, "x", bound);
    }
    slow();
}

fn live(plan: &Plan, sum: &mut Sum) {
    rig::with_gateway(plan.seed, &plan.settings(), |world, rig| {
        let device = plan.device();
        match plan.wire {
            Wire::RtuOverTcp => rig.attach_rtu_over_tcp(world, SERVER, [device]),
            _ => rig.attach(world, "bus", [device]),
        }
        let until = Instant::now() + LENGTH;
        let mut random = Random::new(plan.seed);
        let clients: Vec<_> = (1..=plan.clients)
            .map(|host| {
                let client = rig.client(machine(host), 502);
                world.spawn(ask(client, plan.equal, random.fork(), until))
            })
            .collect();
        let master = plan.cut.then(|| master(world, rig, until));
        let (mut good, mut wrong) = (0, 0);
        for client in clients {
            let (theirs, not) = world.run_until(client);
            (good, wrong) = (good + theirs, wrong + not);
        }
        wrong += master.map_or(0, |master| world.run_until(master));
        let transactions = rig.counted("bus", Event::Request) + rig.counted("bus", Event::Proof);
        sum.transactions += u64::from(transactions);
        sum.good += good;
        sum.wrong += wrong;
        if plan.is_compared() {
            sum.compared += good as f64;
            sum.ideal += plan.ideal();
        }
        if std::env::var("MOBGATE_WORLDS").is_ok() {
            println!("{plan:?}: {transactions} sent, {good} good, {wrong} wrong, ideal {}", plan.ideal());
        }
    });
}

/// A master that asks as well, so that frames are passed on while they arrive; how many of its responses were wrong.
fn master<'w>(world: &World<'w>, rig: &Rig<'w>, until: Instant) -> Task<u64> {
    const READ: [u8; 5] = [3, 0, FRESH as u8, 0, Fresh::REGISTERS as u8];
    let mut master = rig.master("up").with_patience(Duration::from_secs(2));
    world.spawn(async move {
        let mut wrong = 0;
        while Instant::now() < until {
            let asked = Instant::now();
            let response = master.request(1, &READ).await;
            wrong += u64::from(is_good(&READ, asked, &response) == Some(false));
            Timer::after(PAUSE).await;
        }
        wrong
    })
}

/// Asks until `until`; how many responses were good, and how many were wrong.
async fn ask(mut client: Client, equal: bool, mut random: Random, until: Instant) -> (u64, u64) {
    let (mut good, mut wrong) = (0, 0);
    while Instant::now() < until {
        let request = draw(equal, &mut random);
        let asked = Instant::now();
        match is_good(&request, asked, &client.request(1, &request).await) {
            Some(true) => good += 1,
            Some(false) => wrong += 1,
            None => Timer::after(PAUSE).await,
        }
    }
    (good, wrong)
}

fn draw(equal: bool, random: &mut Random) -> Vec<u8> {
    // Below the registers that differ at every read.
    let address = random.within(0..=FRESH as u64 - 10) as u8;
    let count = random.within(1..=3) as u8;
    match if equal { 0 } else { random.index(5) } {
        0 => vec![3, 0, FRESH as u8, 0, Fresh::REGISTERS as u8],
        1 | 2 => vec![3, 0, address, 0, count],
        3 => vec![4, 0, address, 0, count],
        _ => vec![6, 2, address, random.byte(), random.byte()],
    }
}

/// Whether `response` is one to `request`, which was `asked` then; none where there was an exception.
fn is_good(request: &[u8], asked: Instant, response: &Response) -> Option<bool> {
    if response.exception().is_some() || matches!(response, Response::Silence) {
        return None;
    }
    let Response::Pdu(pdu) = response else { return Some(false) };
    Some(match *request {
        [3, 0, 100, 0, 4] => Fresh::from_response(pdu)
            .is_some_and(|fresh| fresh.at_us.wrapping_sub(asked.as_micros() as u32) < u32::MAX / 2),
        [function @ (3 | 4), 0, address, 0, count] => {
            let mask = if function == 4 { 0xff } else { 0 };
            let values = (address..).take(count.into()).flat_map(|address| [1 ^ mask, address ^ mask]);
            let expected: Vec<u8> = [function, 2 * count].into_iter().chain(values).collect();
            *pdu == expected
        }
        _ => pdu == request,
    })
}

const ONE_LINE: &str = "port bus serial bus rtu client 19200 8E1
    port P502 tcp server 502
    route P502 1-247 * * bus
";

/// A device that always needs longer than the time-out.
fn slow() {
    let settings = format!("{ONE_LINE}edit port bus timeout 100ms");
    rig::with_gateway(1, &settings, |world, rig| {
        let late = Fault::Late(Duration::from_millis(110), Duration::from_millis(300));
        let faults = Faults::new(1).with(When::Always, late);
        rig.attach(world, "bus", [Device::new(1).with_fresh(FRESH).with_faults(faults)]);
        let until = Instant::now() + Duration::from_secs(3_600);
        let clients = [false, true].map(|equal| {
            let client = rig.client(machine(1 + u8::from(equal)), 502);
            world.spawn(ask(client, equal, Random::new(u64::from(equal)), until))
        });
        let wrong: u64 = clients.into_iter().map(|client| world.run_until(client).1).sum();
        figure("slow_device_wrong", wrong as f64, "responses", Target::AtMost(0.0));
        let shown = world.run_until(typed(rig.gateway, "show units\n"));
        let named = shown.contains("slower than its time-out: tune");
        figure("slow_device_named", f64::from(u8::from(named)), "-", Target::AtLeast(1.0));
    });
}

/// How long another client of a unit waits behind a request that got no response, from the end of its time: for the proof, and its own
/// transaction.
pub(crate) fn behind_a_time_out() {
    const READ: [u8; 5] = [3, 0, 0, 0, 10];
    // Not the same, or both would share the response that is lost.
    const OTHER: [u8; 5] = [3, 0, 10, 0, 10];
    const ECHO: [u8; 5] = [8, 0, 0, 1, 2];
    rig::with_gateway(1, ONE_LINE, |world, rig| {
        let device = Device::new(1);
        rig.attach(world, "bus", [device.clone()]);
        let mut clients = [1, 2].map(|host| rig.client(machine(host), 502));
        // Whatever the line does at the beginning is over then.
        world.run_until(clients[0].request(1, &READ));
        let mut took = |request: &[u8]| {
            let asked = Instant::now();
            assert_eq!(world.run_until(clients[0].request(1, request)).exception(), None);
            asked.elapsed()
        };
        let alone = took(&READ) + took(&ECHO);
        device.set_faults(Faults::new(1).with(When::Requests(1..=1), Fault::Dead));
        let [mut first, mut second] = clients;
        let first = world.spawn(async move { (first.request(1, &READ).await, Instant::now()) });
        world.run_for(Duration::from_millis(10));
        let second = world.spawn(async move { (second.request(1, &OTHER).await, Instant::now()) });
        let (response, failed) = world.run_until(first);
        assert_eq!(response.exception(), Some(11), "its response was lost");
        let (response, at) = world.run_until(second);
        assert_eq!(response.exception(), None);
        let milliseconds = |time: Duration| time.as_micros() as f64 / 1_000.0;
        let most = Target::AtMost(milliseconds(alone));
        figure("second_client_behind_a_time_out", milliseconds(at - failed), "ms", most);
    });
}
