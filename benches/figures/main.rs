//! The gateway's figures in virtual time: the same on every machine, since no clock of the machine is looked at.
//!
//! Each is printed as `figure NAME VALUE UNIT TARGET ok|short`. Names given as arguments select what is run.

// Linked for the clock and the locks of a host.
use mobgate_clock as _;

mod faults;
mod line;
mod merging;
mod shared_bus;
mod sharing;

/// What a value must be.
#[derive(Clone, Copy)]
pub(crate) enum Target {
    AtLeast(f64),
    AtMost(f64),
}

/// Prints one figure.
pub(crate) fn figure(name: &str, value: f64, unit: &str, target: Target) {
    let (sign, bound, holds) = match target {
        Target::AtLeast(bound) => (">=", bound, value >= bound),
        Target::AtMost(bound) => ("<=", bound, value <= bound),
    };
    let verdict = if holds { "ok" } else { "short" };
    println!("figure {name} {} {unit} {sign}{bound} {verdict}", (value * 1e4).round() / 1e4);
}

fn main() {
    let groups: [(&str, fn()); 5] = [
        ("line", line::figures),
        ("sharing", sharing::figures),
        ("merging", merging::figures),
        ("faults", faults::figures),
        ("shared_bus", shared_bus::figures),
    ];
    // Cargo adds `--bench`; what is left are the names of groups.
    let wanted: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with("--")).collect();
    for (name, figures) in groups {
        if wanted.is_empty() || wanted.iter().any(|group| group == name) {
            figures();
        }
    }
}
