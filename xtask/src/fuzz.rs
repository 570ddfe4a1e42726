//! Fuzzes each framing for some seconds and prints a figure for each. Works with the stable toolchain.

use crate::install::{self, Group};
use crate::tools::{Outcome, command, line};

/// Fuzzes these targets. A failed target does not stop the others.
pub(crate) fn all(seconds: u64, targets: &[String]) -> Outcome {
    install::check(&[Group::Fuzz])?;
    let failed: Vec<&str> =
        targets.iter().filter_map(|target| one(seconds, target).err().map(|_| &**target)).collect();
    if failed.is_empty() { Ok(()) } else { Err(format!("fuzzing failed: {}", failed.join(" "))) }
}

fn one(seconds: u64, target: &str) -> Outcome {
    // The core is free of `unsafe`, so a sanitizer would only slow it down; overflow and range checks stay on.
    let options = "--fuzz-dir tests/fuzz --target-dir target/fuzz --sanitizer none --debug-assertions";
    let mut cargo = command("cargo", &["fuzz", "run"]);
    // cargo-fuzz passes unstable options.
    cargo.args(options.split(' ')).arg(target).env("RUSTC_BOOTSTRAP", "1");
    let again = line(&cargo);
    cargo.args(["--", "-print_final_stats=1"]).arg(format!("-max_total_time={seconds}"));
    let output = cargo.output().map_err(|error| format!("{again}: {error}"))?;
    let log =
        format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    let behind = |words: &str| log.lines().find_map(|line| Some(line.split_once(words)?.1.trim()));
    // Without the final count, libFuzzer did not finish.
    let count = behind("stat::number_of_executed_units:");
    let good = output.status.success() && count.is_some();
    println!("figure fuzz_{target} {} execs - {}", count.unwrap_or("0"), if good { "ok" } else { "short" });
    if good {
        return Ok(());
    }
    // Shows the failure or the build error, and how to reproduce it.
    let lines: Vec<&str> = log.lines().collect();
    let fault = lines.iter().position(|line| line.contains(" panicked at ") || line.starts_with("error"));
    let shown = fault.map_or(lines.len().saturating_sub(20)..lines.len(), |at| at..lines.len().min(at + 5));
    lines[shown].iter().for_each(|line| eprintln!("{line}"));
    if let Some(input) = behind("Test unit written to ") {
        eprintln!("again: RUSTC_BOOTSTRAP=1 {again} {input}");
    }
    Err(target.into())
}
