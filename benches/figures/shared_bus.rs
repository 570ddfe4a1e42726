//! A line on which the gateway and two other devices answer one master: whose questions the gateway answers.

use mobgate::settings::Framing;
use mobgate_simulator::rig::Size;
use mobgate_simulator::shared_bus::{Outcome, torture};

use crate::prelude::*;

const TRANSACTIONS: u32 = 100_000;
/// As late may the Linux program read.
const RESTS: Duration = Duration::from_millis(20);

pub(crate) fn figures() {
    wakes();
    for framing in [Framing::Rtu, Framing::Ascii] {
        let outcome = torture(1, TRANSACTIONS, framing, Size::default());
        let value = |name: &str, value: f64, unit, target| {
            figure(&format!("shared_bus_{framing}_{name}"), value, unit, target);
        };
        let total = f64::from(outcome.transactions);
        value("transactions", total, "transactions", Target::AtLeast(f64::from(TRANSACTIONS)));
        value("others_answered", f64::from(outcome.unsolicited), "responses", Target::AtMost(0.0));
        value("ours_missed", f64::from(outcome.missed), "requests", Target::AtMost(0.0));
        value("collisions", outcome.collisions as f64, "characters", Target::AtMost(0.0));
        // Both kinds must really have been asked for.
        let ours = 100.0 * f64::from(outcome.ours) / total;
        value("ours", ours, "%", Target::AtLeast(30.0));
        value("spoilt", 100.0 * f64::from(outcome.spoilt) / total, "%", Target::AtLeast(5.0));
    }
}

/// How often the gateway is woken for a question and its response, its own and others', by a board that wakes it for each
/// character, and by one that leaves the line alone while characters gather of which none is needed alone.
fn wakes() {
    let [awake, resting] = [Duration::from_ticks(0), RESTS].map(|rests| {
        let size = Size { rests, ..Size::default() };
        torture(1, TRANSACTIONS / 10, Framing::Rtu, size)
    });
    let per_transaction = |outcome: &Outcome| outcome.reads as f64 / f64::from(outcome.transactions);
    figure("shared_bus_wakes_awake", per_transaction(&awake), "reads", Target::None);
    let most = Target::AtMost(per_transaction(&awake));
    figure("shared_bus_wakes_resting", per_transaction(&resting), "reads", most);
}
