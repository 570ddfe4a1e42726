//! What a transaction costs the program, in counts that do not depend on how busy the machine is: user instructions by
//! callgrind, system calls by strace, with eight clients, at a line without pacing and at one with the pace of a wire.
//!
//! The program runs twice under each, with a small and a large number of transactions; the difference is theirs alone.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use rustix::process::Signal;

use crate::Effort;
use crate::common::{Program, free_port, mobgate};
use crate::contestants::{Behind, Contestant, Wired};
use crate::figure::{Target, figure};
use crate::line::{Device, Line};
use crate::load::{Client, Habit, Load, ask_while};

const CLIENTS: usize = 8;

/// A line, and how often each client asks in the short and in the long run.
#[derive(Clone, Copy)]
struct Course {
    /// Stands in the figures' names.
    name: &'static str,
    device: Device,
    counts: [usize; 2],
    /// Instructions and system calls.
    targets: [Target; 2],
}

fn courses() -> [Course; 2] {
    let unpaced = [Target::AtMost(3_000.0), Target::AtMost(8.0)];
    [
        Course { name: "", device: Device::UNPACED, counts: [200, 1_200], targets: unpaced },
        // A wire's response comes in pieces, and silences are waited for.
        Course {
            name: "paced_",
            device: Device::paced(115_200),
            counts: [25, 125],
            targets: [Target::None; 2],
        },
    ]
}

pub(crate) fn figures(_: Effort) {
    let callgrind = |report: &Path| {
        let out = format!("--callgrind-out-file={}", report.display());
        vec!["valgrind".into(), "--tool=callgrind".into(), out]
    };
    let instructions = |report: &str| {
        let totals = report.lines().find_map(|line| line.strip_prefix("totals: "))?;
        totals.trim().parse().ok()
    };
    // Detached, so that the program is the child and gets the signal that ends it.
    let strace = |report: &Path| {
        vec![
            "strace".into(),
            "-D".into(),
            "-f".into(),
            "-c".into(),
            "-o".into(),
            report.display().to_string(),
        ]
    };
    let calls = |report: &str| {
        // 100.00    0.000000           0         0         0 total
        let total = report.lines().find(|line| line.trim_end().ends_with(" total"))?;
        total.split_whitespace().nth(3)?.parse().ok()
    };
    for course in courses() {
        let [most_instructions, most_calls] = course.targets;
        let name = format!("{}instructions_per_transaction", course.name);
        count(&name, course, callgrind, instructions, "instructions", most_instructions);
        let name = format!("{}system_calls_per_transaction", course.name);
        count(&name, course, strace, calls, "calls", most_calls);
    }
}

/// Runs the program under what `tool` says and prints what `read` finds in its report, per transaction.
fn count(
    name: &str,
    course: Course,
    tool: impl Fn(&Path) -> Vec<String>,
    read: impl Fn(&str) -> Option<u64>,
    unit: &str,
    target: Target,
) {
    let counted = course.counts.map(|count| {
        // Kept, for callgrind_annotate.
        let report = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.{count}"));
        let _ = fs::remove_file(&report);
        let answered = run_under(&tool(&report), course.device, count);
        let total: u64 = crate::common::wait_for("the report", || read(&fs::read_to_string(&report).ok()?));
        (total as f64, answered as f64)
    });
    let [(few, few_answered), (many, many_answered)] = counted;
    figure(name, (many - few) / (many_answered - few_answered), unit, target);
}

/// Starts the program under `tool` in front of `device`, lets each client ask `count` times, and ends it. Gives how many
/// were answered: on a busy machine a device with a pace makes gaps in what it says.
fn run_under(tool: &[String], device: Device, count: usize) -> usize {
    let line = Line::with(device);
    let behind = Behind::Line(Wired { device: &line.device(), pace: device.pace, timeout_ms: 5_000 });
    let (folder, port) = (tempfile::tempdir().unwrap(), free_port());
    let gateway = Contestant::Mobgate.command(behind, folder.path(), port).unwrap();
    let mut command = Command::new(&tool[0]);
    command.args(&tool[1..]).arg(mobgate().get_program()).args(gateway.get_args());
    command.stdin(Stdio::null()).stdout(Stdio::null());
    let program = Program::try_start(&mut command, folder, port)
        .unwrap_or_else(|why| panic!("{} is needed (apt-get install valgrind strace): {why}", tool[0]));
    program.logs("is open");
    let mut clients: Vec<Client> = (0..CLIENTS).map(|_| Client::connect(port).unwrap()).collect();
    let habits: Vec<Habit> = (0..CLIENTS).map(Habit::of).collect();
    let loads = ask_while(&mut clients, &habits, |asked| asked < count);
    let sum = |of: fn(&Load) -> u64| loads.iter().map(of).sum::<u64>();
    let (refused, wrong, lost) = (sum(|load| load.refused), sum(|load| load.wrong), sum(|load| load.lost));
    assert_eq!((wrong, lost), (0, 0), "each gets its own answer");
    assert!(10 * refused <= (CLIENTS * count) as u64, "nearly all are answered: {refused} are not");
    program.signal(Signal::TERM);
    program.wait();
    loads.iter().map(|load| load.times.len()).sum()
}
