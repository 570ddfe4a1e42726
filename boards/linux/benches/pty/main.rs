//! What the way through the real program costs, beside a client that is connected to the same kind of PTY directly, and beside
//! the gateways by others that [`contestants`] finds.
//!
//! ```text
//! TCP clients --> mobgate --> PTY --> device        direct client --> PTY --> device
//! TCP clients --> a peer  --> PTY --> device
//! ```
//!
//! The load is the same for all, and comes to them in turn, in several rounds, so that whatever else the machine does meets
//! them alike. Arguments select groups; `--quick` makes fewer and shorter rounds. A value is printed as `figure NAME VALUE UNIT
//! TARGET ok|short`; what depends on the machine has a target only where it is a ratio to something in the same run.

use std::time::Duration;

#[path = "../../tests/peers/authority.rs"]
mod authority;
#[path = "../../tests/common/mod.rs"]
mod common;
mod contestants;
mod counts;
mod ethercat;
#[path = "../../../../benches/figures/figure.rs"]
mod figure;
mod flood;
mod lane;
mod line;
mod load;
mod loads;
mod ports;
mod secure;
mod statistics;
mod tcp_device;
mod usage;

/// How much of everything is run.
#[derive(Clone, Copy)]
pub(crate) struct Effort {
    quick: bool,
}

impl Effort {
    fn rounds(self, rounds: usize) -> usize {
        if self.quick { rounds.min(2) } else { rounds }
    }

    fn length(self, length_ms: u64) -> Duration {
        Duration::from_millis(if self.quick { length_ms / 2 } else { length_ms })
    }
}

/// Runs a group and prints its figures.
type Group = fn(Effort);

fn main() {
    let groups: [(&str, Group); 14] = [
        ("unpaced", loads::unpaced),
        ("paced", loads::paced),
        ("strict", loads::strict),
        ("exceptions", loads::exceptions),
        ("dead", loads::dead),
        ("shared", loads::shared),
        ("polite", loads::polite),
        ("tcp", loads::tcp),
        ("ports", ports::figures),
        ("secure", secure::figures),
        ("flood", flood::figures),
        ("counts", counts::figures),
        ("refusals", counts::refusals),
        ("ethercat", ethercat::figures),
    ];
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let effort = Effort { quick: arguments.iter().any(|argument| argument == "--quick") };
    // Cargo adds `--bench`; what is left are the names of groups.
    let wanted: Vec<&String> = arguments.iter().filter(|argument| !argument.starts_with("--")).collect();
    for (name, run) in groups {
        // These need programs that not everybody has.
        let by_default = wanted.is_empty() && !["counts", "refusals", "ethercat"].contains(&name);
        if by_default || wanted.iter().any(|group| *group == name) {
            run(effort);
        }
    }
}
