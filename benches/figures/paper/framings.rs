//! One router between lines of different framings, or between two ASCII lines: passed on while frames arrive, against the
//! formula and against frames that are stored.

use mobgate::settings::Framing;

use super::chain::through;
use super::formula::{Line, cut_through, direct};
use super::{BAUDS, NANOSECONDS, REGISTERS};
use crate::prelude::*;

pub(super) fn figures() {
    for (baud, registers) in BAUDS.iter().flat_map(|baud| REGISTERS.map(|registers| (*baud, registers))) {
        let (rtu, ascii) = (Line::rtu(baud), Line::ascii(baud));
        for lines in [[rtu, ascii], [ascii, rtu], [ascii, ascii]] {
            one_router(lines, registers);
        }
    }
    // The slower line is the one that counts.
    for [up, down] in [[9_600, 115_200], [115_200, 9_600]] {
        one_router([Line::rtu(up), Line::ascii(down)], 10);
        one_router([Line::ascii(up), Line::rtu(down)], 10);
    }
}

fn one_router([up, down]: [Line; 2], registers: u8) {
    let name = name(up, down, registers);
    let standard = direct(up, registers).max(direct(down, registers));
    let stored = through(&[up, down], registers, "cut off").worst;
    let cut = through(&[up, down], registers, "");
    let formula = cut_through(up, down, registers);
    figure(&format!("stored_{name}"), stored / standard, "x", Target::None);
    let bound = (formula + NANOSECONDS) / standard;
    figure(&format!("cut_{name}"), cut.worst / standard, "x", Target::AtMost(bound));
    let error = 1e6 * (cut.worst - formula);
    figure(&format!("cut_error_{name}"), error, "us", Target::AtMost(1.0));
    figure(&format!("cut_to_stored_{name}"), cut.worst / stored, "x", Target::AtMost(1.0));
    figure(&format!("cut_gaps_{name}"), f64::from(cut.gaps), "frames", Target::AtMost(0.0));
}

fn name(up: Line, down: Line, registers: u8) -> String {
    let framing = |line: Line| if line.framing == Framing::Rtu { "rtu" } else { "ascii" };
    let bauds = match (up.settings.baud, down.settings.baud) {
        (up, down) if up == down => format!("{up}"),
        (up, down) => format!("{up}_to_{down}"),
    };
    format!("{}_to_{}_{bauds}_{registers}", framing(up), framing(down))
}
