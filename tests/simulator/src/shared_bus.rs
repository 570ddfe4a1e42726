//! A line on which the gateway and two other devices answer one master, whose questions are drawn from a seed.
//!
//! The bus obeys t3.5; everything else varies: who is asked, for what, how long everybody pauses, whether the others respond
//! at all, and whether their responses come intact. Their registers hold whole requests for the gateway's units.

use embassy_time::{Duration, Timer};
use mobgate::settings::Framing;

use crate::client::Response;
use crate::device::{Device, Memory, rtu};
use crate::fault::{Fault, Faults, When};
use crate::master::Master;
use crate::random::Random;
use crate::rig::{self, Size};

/// Units that the gateway responds for, and what it calls them.
const OURS: std::ops::RangeInclusive<u8> = 10..=12;
/// Units of the other devices.
const OTHERS: [u8; 2] = [1, 2];
/// Nobody's unit.
const NOBODY: u8 = 77;
/// The gateway's units have values that never change below this address, and are written above.
const WRITTEN_FROM: u8 = 200;

/// What came of it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Questions to anybody.
    pub transactions: u32,
    /// Questions to the gateway's units.
    pub ours: u32,
    /// Of these, those without the right response.
    pub missed: u32,
    /// Questions to others that got no good response, as the seed would have it.
    pub spoilt: u32,
    /// Frames that the gateway sent and nobody had asked it for.
    pub unsolicited: u32,
    /// Characters that overlapped with another end's.
    pub collisions: u64,
    /// How often the gateway was woken by what came.
    pub reads: u64,
}

/// Asks `transactions` questions on a line in `framing` of a gateway on a board of `size`.
pub fn torture(seed: u64, transactions: u32, framing: Framing, size: Size) -> Outcome {
    let format = if framing == Framing::Rtu { "8E1" } else { "7E1" };
    let settings = format!(
        "port S serial up {framing} server 115200 {format}\nport C serial down rtu client 115200 8E1\n\
         route S {}-{} * * C\n",
        OURS.start(),
        OURS.end()
    );
    rig::with_gateway_of(size, seed, &settings, |world, rig| {
        let mut random = Random::new(seed);
        rig.attach(world, "up", OTHERS.map(|unit| other(unit, random.bits())));
        rig.attach(world, "down", OURS.map(Device::new).collect::<Vec<_>>());
        let mut master = rig.master("up").with_patience(Duration::from_millis(100));
        let mut outcome = Outcome::default();
        world.run_for(Duration::from_millis(100));
        for _ in 0..transactions {
            world.run_until(transaction(&mut master, &mut random, &mut outcome));
        }
        let asked = outcome.ours;
        outcome.unsolicited = (rig.sent("up").frames as u32).saturating_sub(asked);
        let gateway = rig.end("up").number();
        let frames = rig.wire("up").frames();
        let own = frames.iter().filter(|frame| frame.from == gateway);
        outcome.unsolicited += own.filter(|frame| !is_ours(framing, &frame.bytes)).count() as u32;
        outcome.reads = rig.sent("up").reads;
        outcome.collisions = rig.wire("up").collisions();
        outcome
    })
}

fn is_ours(framing: Framing, frame: &[u8]) -> bool {
    crate::framing::open(framing, frame).is_some_and(|(unit, _)| OURS.contains(&unit))
}

/// A device that has nothing to do with the gateway, and its bad days.
fn other(unit: u8, seed: u64) -> Device {
    let device = Device::new(unit).with_turnaround(Duration::from_micros(seed % 2_000));
    let faults = [
        (0.05, Fault::Dead),
        (0.03, Fault::BadCrc),
        (0.03, Fault::Truncated),
        (0.03, Fault::Exception(4)),
        (0.03, Fault::WrongLength),
    ];
    let faults = faults
        .into_iter()
        .fold(Faults::new(seed), |faults, (chance, fault)| faults.with(When::Chance(chance), fault));
    let bait = rtu::frame(*OURS.start(), &[3, 0, 0, 0, 1]);
    for (register, word) in device.memory().holding.iter_mut().zip(bait.chunks_exact(2).cycle()) {
        *register = u16::from_be_bytes([word[0], word[1]]);
    }
    device.with_faults(faults)
}

async fn transaction(master: &mut Master, random: &mut Random, outcome: &mut Outcome) {
    let unit = match random.index(20) {
        0..=8 => random.within(u64::from(*OURS.start())..=u64::from(*OURS.end())) as u8,
        9..=18 => OTHERS[random.index(2)],
        _ => NOBODY,
    };
    let request = draw_request(random);
    outcome.transactions += 1;
    let response = master.request(unit, &request).await;
    if OURS.contains(&unit) {
        let expected = Memory::new(unit).execute(&request);
        let right = expected.is_ok_and(|expected| response == Response::Pdu(expected));
        outcome.ours += 1;
        outcome.missed += u32::from(!right);
    } else {
        outcome.spoilt += u32::from(!matches!(response, Response::Pdu(_)));
    }
    // In RTU t3.5 of silence have told the response's end; often that is all the master waits. In ASCII it needs none.
    let pause_us = match random.index(4) {
        0 | 1 => 0,
        2 => random.within(0..=3_000),
        _ => random.within(0..=40_000),
    };
    Timer::after_micros(pause_us).await;
}

fn draw_request(random: &mut Random) -> Vec<u8> {
    let address = random.within(0..=40) as u8;
    let count = random.within(1..=20) as u8;
    let (high, low) = (random.byte(), random.byte());
    match random.index(8) {
        0..=2 => vec![3, 0, address, 0, count],
        3 => vec![4, 0, address, 0, count],
        4 => vec![1, 0, address, 0, count],
        5 => vec![6, 0, WRITTEN_FROM, high, low],
        6 => vec![16, 0, WRITTEN_FROM, 0, 1, 2, high, low],
        _ => vec![65, high, low],
    }
}
