//! The evaluation of the MobGate paper: how long a transaction takes directly, through routers, and through a loaded one.
//!
//! `direct` is Tstd: from the request's first bit to the answer's last one. Through a router it is what the master sees on its own
//! line. Each figure is the worst of many transactions.

use embassy_time::{Duration, Timer};
use mobgate::config::LineSettings;
use mobgate::stats::Event;
use mobgate_simulator::client::Answer;
use mobgate_simulator::rig::machine;
use mobgate_simulator::{Device, Master, Random, Rig, World, rig};

use crate::{Target, figure};

const BAUDS: [u32; 3] = [9_600, 19_200, 115_200];
const REGISTERS: [u8; 3] = [1, 10, 125];
/// The device answers so long after it has seen t3.5 of silence.
const TURNAROUND: f64 = 0.001;
/// The clock's tick: each of the two frames of a transaction may be passed on so much later than the formula says, since
/// its first character is noticed at the tick after its end.
const TICK: f64 = 1e-6;
const REQUEST: f64 = 8.0;
const TRANSACTIONS: u32 = 50;
const UNIT: u8 = 1;

/// One line of a chain.
#[derive(Clone, Copy)]
struct Line(LineSettings);

impl Line {
    fn new(baud: u32) -> Self {
        Self(LineSettings { baud, ..LineSettings::DEFAULT })
    }

    /// Seconds of one character.
    fn tc(self) -> f64 {
        f64::from(self.0.bits_per_char()) / f64::from(self.0.baud)
    }

    fn t3_5(self) -> f64 {
        if self.0.baud > 19_200 { 0.001_75 } else { 3.5 * self.tc() }
    }
}

/// Characters of the answer.
fn answer_chars(registers: u8) -> f64 {
    5.0 + 2.0 * f64::from(registers)
}

/// Tstd of `line`, in seconds.
fn direct(line: Line, registers: u8) -> f64 {
    (REQUEST + answer_chars(registers)) * line.tc() + line.t3_5() + TURNAROUND
}

/// From the first bit of a frame of `chars` characters to the last bit of its copy, which may begin with the first one.
fn leg(chars: f64, input: Line, output: Line) -> f64 {
    (input.tc() + chars * output.tc()).max(chars * input.tc() + output.tc())
}

/// The formula of cut-through from `up` to `down`. The answer on the upper line keeps its distance from the request, which
/// the silence on a fast lower line does not give where the upper one is slow.
fn cut_through(up: Line, down: Line, registers: u8) -> f64 {
    let answer = answer_chars(registers);
    let there = leg(REQUEST, up, down);
    let back = down.t3_5() + TURNAROUND + leg(answer, down, up);
    (there + back).max((REQUEST + answer) * up.tc() + up.t3_5())
}

/// The formula of routers that wait for the silence behind every frame.
fn store_and_forward(up: Line, down: Line, registers: u8) -> f64 {
    let chars = REQUEST + answer_chars(registers);
    chars * (up.tc() + down.tc()) + up.t3_5() + 2.0 * down.t3_5() + TURNAROUND
}

pub(crate) fn figures() {
    for baud in BAUDS {
        for registers in REGISTERS {
            one_router(baud, registers);
        }
    }
    pairs_of_speeds();
    routers_in_a_row();
    for baud in BAUDS {
        REGISTERS.into_iter().for_each(|registers| loaded(baud, registers));
    }
    BAUDS.into_iter().for_each(goodput);
}

/// How many times as long as directly a transaction takes: stored, and passed on while it arrives.
pub(crate) struct Factors {
    pub(crate) measured: [f64; 2],
    pub(crate) formula: [f64; 2],
}

/// The factors of one router.
pub(crate) fn factors(baud: u32, registers: u8) -> Factors {
    let line = Line::new(baud);
    let standard = direct(line, registers);
    let measured = ["cut off", ""].map(|rule| through(&[baud, baud], registers, rule, 0).worst / standard);
    let formula = [store_and_forward, cut_through].map(|formula| formula(line, line, registers) / standard);
    Factors { measured, formula }
}

fn one_router(baud: u32, registers: u8) {
    let line = Line::new(baud);
    let standard = direct(line, registers);
    let alone = alone(baud, registers);
    figure(&format!("direct_{baud}_{registers}"), 1e3 * alone, "ms", Target::None);
    figure(&format!("direct_error_{baud}_{registers}"), 1e6 * (alone - standard), "us", Target::AtMost(1.0));
    let stored = through(&[baud, baud], registers, "cut off", 0).worst;
    figure(
        &format!("stored_{baud}_{registers}"),
        stored / standard,
        "x",
        Target::AtMost(store_and_forward(line, line, registers) / standard),
    );
    let cut = through(&[baud, baud], registers, "", 0);
    let formula = cut_through(line, line, registers);
    let bound = (formula + 2.0 * TICK) / standard;
    figure(&format!("cut_{baud}_{registers}"), cut.worst / standard, "x", Target::AtMost(bound));
    figure(
        &format!("cut_error_{baud}_{registers}"),
        1e6 * (cut.worst - formula) / 2.0,
        "us/frame",
        Target::AtMost(1.0),
    );
    figure(&format!("cut_gaps_{baud}_{registers}"), f64::from(cut.gaps), "frames", Target::AtMost(0.0));
}

fn pairs_of_speeds() {
    for (up, down) in [
        (9_600, 19_200),
        (19_200, 9_600),
        (9_600, 115_200),
        (115_200, 9_600),
        (19_200, 115_200),
        (115_200, 19_200),
    ] {
        let (upper, lower) = (Line::new(up), Line::new(down));
        let slower = direct(Line::new(up.min(down)), 10);
        let cut = through(&[up, down], 10, "", 0);
        let formula = cut_through(upper, lower, 10);
        let bound = if up == 115_200 && down == 19_200 { 1.02 } else { (formula + 2.0 * TICK) / slower };
        figure(&format!("cut_{up}_to_{down}_10"), cut.worst / slower, "x", Target::AtMost(bound));
        figure(
            &format!("cut_error_{up}_to_{down}_10"),
            1e6 * (cut.worst - formula) / 2.0,
            "us/frame",
            Target::AtMost(1.0),
        );
        figure(&format!("cut_gaps_{up}_to_{down}_10"), f64::from(cut.gaps), "frames", Target::AtMost(0.0));
    }
}

fn routers_in_a_row() {
    let standard = direct(Line::new(19_200), 10);
    for (routers, bound) in [(2, 1.11), (3, 1.16)] {
        let bauds = vec![19_200; routers + 1];
        let stored = through(&bauds, 10, "cut off", 0).worst;
        figure(&format!("stored_{routers}_routers_19200_10"), stored / standard, "x", Target::None);
        let cut = through(&bauds, 10, "", 0);
        figure(&format!("cut_{routers}_routers_19200_10"), cut.worst / standard, "x", Target::AtMost(bound));
        figure(
            &format!("cut_gaps_{routers}_routers_19200_10"),
            f64::from(cut.gaps),
            "frames",
            Target::AtMost(0.0),
        );
    }
}

/// The same with three other lines of the router at their legal rates.
fn loaded(baud: u32, registers: u8) {
    let unloaded = through(&[baud, baud], registers, "", 0).worst;
    let loaded = through(&[baud, baud], registers, "", 3).worst;
    figure(&format!("cut_loaded_{baud}_{registers}"), loaded / unloaded, "x", Target::AtMost(1.01));
}

/// A device that drops a request after an illegal silence or with a gap inside, asked as fast as a master may.
fn goodput(baud: u32) {
    let (mut answered, mut asked) = (0, 0);
    chain(&[baud, baud], "", 0, |world, rig, device| {
        let mut master = rig.master("w0@0");
        asked = 1_000;
        for _ in 0..asked {
            let answer = world.run_until(master.request(UNIT, &read(10)));
            answered += u32::from(matches!(answer, Answer::Pdu(_)));
        }
        assert_eq!(device.counters().bad_crc + device.counters().gap_inside, 0);
        let t3_5 = Line::new(baud).t3_5();
        let gap = rig.sent("w1@1").shortest_gap_ns.unwrap_or(0) as f64 / 1e9;
        figure(&format!("cut_shortest_gap_{baud}"), gap / t3_5, "t3.5", Target::AtLeast(1.0));
    });
    figure(&format!("cut_goodput_{baud}"), f64::from(answered) / f64::from(asked), "-", Target::AtLeast(1.0));
}

fn read(registers: u8) -> [u8; 5] {
    [3, 0, 0, 0, registers]
}

/// What was seen of many transactions.
struct Seen {
    /// From the request's first bit to the answer's last one, in seconds.
    worst: f64,
    /// Frames with a gap inside that a device would not have taken.
    gaps: u32,
}

/// The worst transaction without a router.
fn alone(baud: u32, registers: u8) -> f64 {
    rig::with_gateway(1, &format!("port C serial bus rtu client {baud} 8E1\n"), |world, rig| {
        rig.attach(world, "bus", [Device::new(UNIT).with_turnaround(turnaround())]);
        let mut master = rig.master("bus");
        world.run_for(Duration::from_millis(100));
        measure(world, rig, ("bus", "bus"), registers, &mut master)
    })
}

/// The worst transaction through routers, on lines of these speeds.
fn through(bauds: &[u32], registers: u8, rule: &str, others: usize) -> Seen {
    chain(bauds, rule, others, |world, rig, _| {
        let mut master = rig.master("w0@0");
        let last = bauds.len() - 1;
        let worst = measure(world, rig, ("w0@0", &format!("w{last}@{last}")), registers, &mut master);
        let cut = if rule.is_empty() { TRANSACTIONS } else { 0 };
        assert_eq!(rig.counted("C1", Event::Cut), cut, "passed on as the rule says");
        let gaps = (0..bauds.len()).map(|hop| split(rig, hop, registers)).sum();
        Seen { worst, gaps }
    })
}

/// Frames on the line `hop` that were not whole when the first silence over t1.5 came in them, as sent by the gateway.
fn split(rig: &Rig<'_>, hop: usize, registers: u8) -> u32 {
    let device = format!("w{hop}@{hop}");
    let wanted = [8, answer_chars(registers) as usize];
    let frames = rig.wire(&device).frames();
    frames.iter().filter(|frame| !wanted.contains(&frame.bytes.len())).count() as u32
}

/// A chain of routers, each on two lines, with a device behind the last one; and `others` pairs of lines besides, all at
/// their legal rate.
fn chain<T>(
    bauds: &[u32],
    rule: &str,
    others: usize,
    scenario: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>, &Device) -> T,
) -> T {
    let mut settings = String::new();
    for hop in 1..bauds.len() {
        let (up, down) = (hop - 1, hop);
        settings += &format!(
            "port S{hop} serial w{up}@{up} rtu server {} 8E1\nport C{hop} serial w{down}@{} rtu client {} 8E1\nroute S{hop} * * * C{hop} {rule}\n",
            bauds[up],
            if hop + 1 < bauds.len() { format!("{down}c") } else { format!("{down}") },
            bauds[down]
        );
    }
    for other in 0..others {
        settings += &format!(
            "port L{other} serial l{other} rtu client 115200 8E1\nport T{other} tcp server {}\nroute T{other} * * * L{other}\n",
            5_000 + other
        );
    }
    rig::with_gateway(1, &settings, |world, rig| {
        let device = Device::new(UNIT).with_turnaround(turnaround());
        let last = bauds.len() - 1;
        rig.attach(world, &format!("w{last}@{last}"), [device.clone()]);
        for other in 0..others {
            rig.attach(world, &format!("l{other}"), [Device::new(UNIT)]);
            let mut client = rig.client(machine(1), 5_000 + other as u16);
            world.spawn(async move {
                loop {
                    client.request(UNIT, &read(10)).await;
                }
            });
        }
        world.run_for(Duration::from_millis(100));
        scenario(world, rig, &device)
    })
}

fn turnaround() -> Duration {
    Duration::from_micros((TURNAROUND * 1e6) as u64)
}

/// Asks many times, and looks at the first wire for how long that takes at most, in seconds. The device behind the last one
/// hears the silence and counts its turnaround in whole ticks of the clock: what it takes too long is not counted.
fn measure(
    world: &mut World<'_>,
    rig: &Rig<'_>,
    (first, last): (&str, &str),
    registers: u8,
    master: &mut Master,
) -> f64 {
    let mut random = Random::new(u64::from(registers));
    for _ in 0..TRANSACTIONS {
        // At any moment, later than t3.5 after the last transaction on every line.
        let pause = Duration::from_micros(random.within(20_000..=50_000));
        let answer = world.run_until(async {
            Timer::after(pause).await;
            master.request(UNIT, &read(registers)).await
        });
        assert!(matches!(answer, Answer::Pdu(_)), "{answer:?}");
    }
    let seconds = |from_ns: u64, to_ns: u64| (to_ns - from_ns) as f64 / 1e9;
    let device = Line(rig.end(last).line()).t3_5() + TURNAROUND;
    let (asked, answered) = (rig.wire(first).frames(), rig.wire(last).frames());
    let pairs = asked.chunks_exact(2).zip(answered.chunks_exact(2));
    let took = pairs.map(|(asker, answerer)| {
        let late = seconds(answerer[0].end_ns, answerer[1].start_ns) - device;
        seconds(asker[0].start_ns, asker[1].end_ns) - late
    });
    took.fold(0.0, f64::max)
}
