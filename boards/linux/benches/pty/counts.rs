//! What a transaction costs the program, in counts that do not depend on how busy the machine is: user instructions by
//! callgrind, system calls by strace, at a line without pacing and eight clients.
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
use crate::line::{Device, Line, Pace};
use crate::load::{Client, Habit, ask_while};

const CLIENTS: usize = 8;
/// Transactions of each client in the short and in the long run.
const COUNTS: [usize; 2] = [200, 1_200];

pub(crate) fn figures(_: Effort) {
    let callgrind = |report: &Path| {
        let out = format!("--callgrind-out-file={}", report.display());
        vec!["valgrind".into(), "--tool=callgrind".into(), out]
    };
    let instructions = |report: &str| {
        let totals = report.lines().find_map(|line| line.strip_prefix("totals: "))?;
        totals.trim().parse().ok()
    };
    let name = "instructions_per_transaction";
    count(name, callgrind, instructions, "instructions", 3_000.0);

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
    count("system_calls_per_transaction", strace, calls, "calls", 8.0);
}

/// Runs the program under what `tool` says and prints what `read` finds in its report, per transaction.
fn count(
    name: &str,
    tool: impl Fn(&Path) -> Vec<String>,
    read: impl Fn(&str) -> Option<u64>,
    unit: &str,
    at_most: f64,
) {
    let counted = COUNTS.map(|count| {
        // Kept, for callgrind_annotate.
        let report = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.{count}"));
        let _ = fs::remove_file(&report);
        run_under(&tool(&report), count);
        crate::common::wait_for("the report", || read(&fs::read_to_string(&report).ok()?))
    });
    let transactions = (COUNTS[1] - COUNTS[0]) * CLIENTS;
    figure(name, (counted[1] - counted[0]) as f64 / transactions as f64, unit, Target::AtMost(at_most));
}

/// Starts the program under `tool`, lets each client ask `count` times, and ends it.
fn run_under(tool: &[String], count: usize) {
    let line = Line::with(Device::UNPACED);
    let behind = Behind::Line(Wired { device: &line.device(), pace: Pace::NONE, timeout_ms: 5_000 });
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
    assert!(loads.iter().all(|load| load.times.len() == count), "all are answered");
    program.signal(Signal::TERM);
    program.wait();
}
