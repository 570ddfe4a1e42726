//! The evaluation of the MobGate paper: how long a transaction takes directly and through routers. (What a loaded one adds is the
//! processor's time, which the emulated board counts: tests/qemu.)
//!
//! `direct` is Tstd: from the request's first bit to the response's last one. Through a router it is what the master sees on its own
//! line. Each figure is the worst of many transactions.

use crate::prelude::*;

mod chain;
mod formula;
mod framings;

use chain::{alone, chain, read, through};
use formula::{Line, cut_through, direct, store_and_forward};

const BAUDS: [u32; 3] = [9_600, 19_200, 115_200];
const REGISTERS: [u8; 3] = [1, 10, 125];
/// The device responds so long after it has heard the end of the request.
const TURNAROUND: f64 = 0.001;
/// The clock's tick. No frame begins between two: the copy of one that arrives begins at the tick after the moment that the paper's
/// formula gives, in the formulas here as well.
const TICK: f64 = 1e-6;
/// What wires that round each end of a character to a nanosecond may add to a transaction.
const NANOSECONDS: f64 = 1e-8;
const UNIT: u8 = 1;
/// The bytes of a response in front of its values.
const UNIT_FUNCTION_COUNT: f64 = 3.0;

pub(crate) fn figures() {
    for baud in BAUDS {
        for registers in REGISTERS {
            one_router(baud, registers);
        }
    }
    pairs_of_speeds();
    framings::figures();
    routers_in_a_row();
    BAUDS.into_iter().for_each(goodput);
}

/// How many times as long as directly a transaction takes: stored, and passed on while it arrives.
pub(crate) struct Factors {
    pub(crate) measured: [f64; 2],
    pub(crate) formula: [f64; 2],
}

/// The factors of one router.
pub(crate) fn factors(baud: u32, registers: u8) -> Factors {
    let line = Line::rtu(baud);
    let standard = direct(line, registers);
    let measured = ["cut off", ""].map(|rule| through(&[line, line], registers, rule).worst / standard);
    let formula = [store_and_forward, cut_through].map(|formula| formula(line, line, registers) / standard);
    Factors { measured, formula }
}

fn one_router(baud: u32, registers: u8) {
    let line = Line::rtu(baud);
    let standard = direct(line, registers);
    let alone = alone(line, registers);
    figure(&format!("direct_{baud}_{registers}"), 1e3 * alone, "ms", Target::None);
    figure(&format!("direct_error_{baud}_{registers}"), 1e6 * (alone - standard), "us", Target::AtMost(1.0));
    let stored = through(&[line, line], registers, "cut off").worst;
    let bound = store_and_forward(line, line, registers) / standard;
    figure(&format!("stored_{baud}_{registers}"), stored / standard, "x", Target::AtMost(bound));
    let cut = through(&[line, line], registers, "");
    let formula = cut_through(line, line, registers);
    let bound = (formula + NANOSECONDS) / standard;
    figure(&format!("cut_{baud}_{registers}"), cut.worst / standard, "x", Target::AtMost(bound));
    figure(&format!("cut_error_{baud}_{registers}"), 1e6 * (cut.worst - formula), "us", Target::AtMost(1.0));
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
        let (upper, lower) = (Line::rtu(up), Line::rtu(down));
        let slower = direct(Line::rtu(up.min(down)), 10);
        let cut = through(&[upper, lower], 10, "");
        let formula = cut_through(upper, lower, 10);
        let bound = if up == 115_200 && down == 19_200 { 1.02 } else { (formula + NANOSECONDS) / slower };
        figure(&format!("cut_{up}_to_{down}_10"), cut.worst / slower, "x", Target::AtMost(bound));
        let error_us = 1e6 * (cut.worst - formula);
        figure(&format!("cut_error_{up}_to_{down}_10"), error_us, "us", Target::AtMost(1.0));
        figure(&format!("cut_gaps_{up}_to_{down}_10"), f64::from(cut.gaps), "frames", Target::AtMost(0.0));
    }
}

fn routers_in_a_row() {
    let standard = direct(Line::rtu(19_200), 10);
    for (routers, bound) in [(2, 1.11), (3, 1.16)] {
        let lines = vec![Line::rtu(19_200); routers + 1];
        let stored = through(&lines, 10, "cut off").worst;
        figure(&format!("stored_{routers}_routers_19200_10"), stored / standard, "x", Target::None);
        let cut = through(&lines, 10, "");
        figure(&format!("cut_{routers}_routers_19200_10"), cut.worst / standard, "x", Target::AtMost(bound));
        let name = format!("cut_gaps_{routers}_routers_19200_10");
        figure(&name, f64::from(cut.gaps), "frames", Target::AtMost(0.0));
    }
}

/// A device that drops a request after an illegal silence or with a gap inside, asked as fast as a master may.
fn goodput(baud: u32) {
    let (mut answered, mut asked) = (0, 0);
    chain(&[Line::rtu(baud); 2], "", |world, rig, device| {
        let mut master = rig.master("w0@0");
        asked = 1_000;
        for _ in 0..asked {
            let response = world.run_until(master.request(UNIT, &read(10)));
            answered += u32::from(matches!(response, Response::Pdu(_)));
        }
        assert_eq!(device.counters().bad_crc + device.counters().gap_inside, 0);
        let t3_5 = Line::rtu(baud).t3_5();
        let gap = rig.sent("w1@1").shortest_gap_ns.unwrap_or(0) as f64 / 1e9;
        figure(&format!("cut_shortest_gap_{baud}"), gap / t3_5, "t3.5", Target::AtLeast(1.0));
    });
    figure(&format!("cut_goodput_{baud}"), f64::from(answered) / f64::from(asked), "-", Target::AtLeast(1.0));
}
