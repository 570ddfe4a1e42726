//! A line on which the gateway and two other devices answer one master: whose questions the gateway answers.

use embassy_time::Duration;
use mobgate::config::Framing;
use mobgate_simulator::shared_bus::torture;

use crate::{Target, figure};

const TRANSACTIONS: u32 = 100_000;

pub(crate) fn figures() {
    for framing in [Framing::Rtu, Framing::Ascii] {
        let outcome = torture(1, TRANSACTIONS, framing, Duration::from_ticks(0));
        let value = |name: &str, value: f64, unit, target| {
            figure(&format!("shared_bus_{framing}_{name}"), value, unit, target);
        };
        let total = f64::from(outcome.transactions);
        value("transactions", total, "transactions", Target::AtLeast(f64::from(TRANSACTIONS)));
        value("others_answered", f64::from(outcome.unasked), "answers", Target::AtMost(0.0));
        value("ours_missed", f64::from(outcome.missed), "requests", Target::AtMost(0.0));
        value("collisions", outcome.collisions as f64, "characters", Target::AtMost(0.0));
        // Both kinds must really have been asked for.
        let ours = 100.0 * f64::from(outcome.ours) / total;
        value("ours", ours, "%", Target::AtLeast(30.0));
        value("spoilt", 100.0 * f64::from(outcome.spoilt) / total, "%", Target::AtLeast(5.0));
    }
}
