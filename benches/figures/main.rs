//! The gateway's figures in virtual time and of simulated flash: the same on every machine, since no clock of the machine
//! is looked at.
//!
//! Each is printed as `figure NAME VALUE UNIT TARGET ok|short`. Names given as arguments select what is run; `plot`
//! draws docs/paper.svg; `drive`, which takes as long as all others, and `page_instructions`, which needs valgrind, are only run by
//! name.

// Linked for the clock and the locks of a host.
use mobgate_clock as _;

mod drive;
mod ethercat;
mod faults;
mod figure;
mod goodput;
mod in_step;
mod line;
mod merging;
mod pages;
mod paper;
mod plot;
mod points;
mod ports;
mod power_cuts;
mod prelude;
mod publishers;
mod servers;
mod shared_bus;
mod sharing;
mod stations;
mod tools;

use figure::{Target, figure};

fn main() {
    let groups: &[(&str, fn())] = &[
        ("line", line::figures),
        ("pages", pages::figures),
        ("page_instructions", pages::instructions),
        ("paper", paper::figures),
        ("sharing", sharing::figures),
        ("merging", merging::figures),
        ("faults", faults::figures),
        ("in_step", in_step::figures),
        ("behind_a_time_out", in_step::behind_a_time_out),
        ("shared_bus", shared_bus::figures),
        ("points", points::figures),
        ("stations", stations::figures),
        ("ports", ports::figures),
        ("goodput", goodput::figures),
        ("servers", servers::figures),
        ("publishers", publishers::figures),
        ("tools", tools::figures),
        ("power_cuts", power_cuts::figures),
        ("ethercat", ethercat::figures),
        ("drive", drive::figures),
    ];
    // Cargo adds `--bench`; what is left are the names of groups.
    let wanted: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with("--")).collect();
    if wanted.iter().any(|group| group == "plot") {
        plot::draw().expect("a folder in which docs/ can be written");
    }
    for (name, figures) in groups {
        let by_name_only = ["drive", "page_instructions"].contains(name);
        if wanted.is_empty() && !by_name_only || wanted.iter().any(|group| group == name) {
            figures();
        }
    }
}
