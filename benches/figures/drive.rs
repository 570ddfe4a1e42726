//! The drive test of thirty days in virtual time: whole, as fast as this machine can.

use indicatif::{ProgressBar, ProgressStyle};
use mobgate_simulator::drive::{Conditions, drive};

use crate::line::seconds;
use crate::prelude::*;

const DAY: Duration = Duration::from_secs(24 * 60 * 60);
const DAYS: u32 = 30;
/// A value that takes longer is an error: the bound of the source's drive test.
const LONGEST: Duration = Duration::from_secs(3);
/// What a person waits for.
const WALL_SECONDS: f64 = 60.0;

pub(crate) fn figures() {
    let bar = ProgressBar::new((DAY * DAYS).as_secs());
    let style = ProgressStyle::with_template("{wide_bar} {percent:>3} % of 30 days, {elapsed}, {eta} left");
    bar.set_style(style.expect("a template that is right"));
    let (begin, had) = (std::time::Instant::now(), processor_seconds());
    let usual = Conditions::USUAL;
    let outcome =
        drive(usual, 30, DAY * DAYS, Duration::from_ticks(0), |passed| bar.set_position(passed.as_secs()));
    let (wall, processor) = (begin.elapsed().as_secs_f64(), processor_seconds() - had);
    bar.finish_and_clear();
    // A value that comes at any moment of the polling, and not always just after one.
    let any = drive(usual, 1, DAY, Duration::from_secs(1), |_| {});
    figure("drive_days", DAYS.into(), "days", Target::None);
    figure("drive_values", outcome.values as f64, "values", Target::None);
    figure("drive_requests", outcome.requests as f64, "requests", Target::None);
    figure("drive_worst_s", seconds(outcome.worst), "s", Target::AtMost(seconds(LONGEST)));
    figure("drive_worst_any_moment_s", seconds(any.worst), "s", Target::AtMost(seconds(LONGEST)));
    figure("drive_errors", (outcome.errors + any.errors) as f64, "errors", Target::AtMost(0.0));
    figure("drive_wall_s", wall, "s", Target::AtMost(WALL_SECONDS));
    // Of that what was not spent on waiting for a processor that others had.
    figure("drive_processor_s", processor, "s", Target::AtMost(WALL_SECONDS));
}

/// How long this thread has had a processor, as the kernel counts it.
fn processor_seconds() -> f64 {
    let times = std::fs::read_to_string("/proc/thread-self/schedstat").expect("a Linux machine");
    let nanos: u64 = times.split(' ').next().and_then(|nanos| nanos.parse().ok()).expect("a number");
    nanos as f64 / 1e9
}
