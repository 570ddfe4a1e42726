//! Runs the tests that depend on the machine's clock many times in a row, beside busy threads. Prints a line for each test program
//! and a figure.

use std::process::{Command, Stdio};
use std::time::Instant;

use clap::Args;

use crate::tools::{Outcome, cargo, command, figure};

/// Number of runs, and the load.
#[derive(Args)]
pub(crate) struct Choice {
    #[arg(default_value_t = 10)]
    runs: usize,
    /// Threads that spin
    #[arg(default_value_t = 8)]
    busy: usize,
    /// Only the programs whose arguments contain this
    #[arg(long, default_value = "")]
    only: String,
}

/// Arguments for cargo, with filters for the tests that depend on a clock.
const PROGRAMS: [&str; 15] = [
    "--package mobgate-linux --lib",
    "--package mobgate-linux --test tcp_clients",
    "--package mobgate-linux --test tcp_servers",
    "--package mobgate-linux --test serial_lines",
    "--package mobgate-linux --test command_line",
    "--package mobgate-linux --test consoles",
    "--package mobgate-linux --test capture",
    "--package mobgate-linux --test hosts_tcp",
    "--package mobgate-linux --test hosts_tty",
    "--package mobgate-linux --test peers",
    "--package mobgate-linux --test mdns",
    "--package mobgate-linux --test ethercat",
    "--test ethercat -- pysoem",
    "--test ethercat -- foreign",
    "--package mobgate-qemu --test qemu",
];

/// Runs them all; a test that fails under load is a bug.
pub(crate) fn run_all(choice: &Choice) -> Outcome {
    let programs = PROGRAMS.iter().filter(|program| program.contains(&choice.only));
    // Built before the load starts.
    let built = programs.map(|program| Ok((*program, build(program)?))).collect::<Outcome<Vec<_>>>()?;
    for _ in 0..choice.busy {
        // They end with this process.
        std::thread::spawn(|| {
            loop {
                std::hint::spin_loop();
            }
        });
    }
    let mut failed = 0;
    for (program, executable) in &built {
        let begin = Instant::now();
        let good = (1..=choice.runs).filter(|nth| passes(program, executable, *nth)).count();
        failed += choice.runs - good;
        let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
        let load = load.split(' ').next().unwrap_or_default();
        println!("{good} of {}: {program} ({} s, load {load})", choice.runs, begin.elapsed().as_secs());
    }
    figure("under_load_failed", failed as f64, "runs", Some(0.0));
    if failed == 0 { Ok(()) } else { Err(format!("{failed} runs failed")) }
}

/// Builds a test program and returns its path.
fn build(program: &str) -> Outcome<String> {
    let words = program.split(" -- ").next().unwrap_or(program).split(' ').collect::<Vec<_>>();
    let output = cargo("test", &["--no-run"]).args(words).output().map_err(|error| error.to_string())?;
    let log = String::from_utf8_lossy(&output.stderr);
    let mut executables = log.lines().filter(|line| line.trim_start().starts_with("Executable "));
    let path = executables.next().and_then(|line| line.rsplit_once('(')?.1.strip_suffix(')'));
    path.map(str::to_owned).ok_or_else(|| format!("{program} is not built:\n{log}"))
}

fn passes(program: &str, executable: &str, nth: usize) -> bool {
    let mut run: Command = command(executable, &[""; 0]);
    run.args(program.split_once(" -- ").map(|(_, filter)| filter))
        .stdin(Stdio::null())
        .env("RUST_BACKTRACE", "0");
    let Ok(output) = run.output() else { return false };
    if output.status.success() {
        return true;
    }
    println!("run {nth} of {program}:");
    let log =
        format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    let lines: Vec<&str> = log.lines().collect();
    let panics = (0..lines.len()).filter(|at| lines[*at].contains("panicked at"));
    panics.flat_map(|at| lines.iter().skip(at).take(9)).take(60).for_each(|line| println!("{line}"));
    false
}
