//! Measures mobgate beside third-party gateways: the same loads on the same devices, in turn, in one run. Prints a table for each
//! load and a line for each figure; takes about a quarter of an hour, with --quick about five minutes.

use std::path::Path;
use std::process::Command;

use clap::Args;

use crate::test;
use crate::tools::{Outcome, command, root, run};

/// Loads to run.
#[derive(Args)]
#[command(
    after_help = "MBUSD=/path/to/mbusd takes mbusd along, which no package registry has. modbus-relay needs pkg-config and libudev-dev."
)]
pub(crate) struct Choice {
    /// Shorter runs
    #[arg(long)]
    quick: bool,
    #[arg(default_values = ["unpaced", "paced", "strict", "exceptions", "dead", "shared", "polite", "tcp"])]
    groups: Vec<String>,
}

/// Installs the peers into target/peers and measures. Peers that cannot be installed are reported and skipped.
pub(crate) fn measure(choice: &Choice) -> Outcome {
    let peers = root().join("target/peers");
    std::fs::create_dir_all(&peers).map_err(|error| format!("{}: {error}", peers.display()))?;
    // The versions measured in docs/performance.md.
    for name in ["modbus-relay@2025.11.0", "modbus-gateway@0.2.0", "modbus-proxy-rs@1.0.0"] {
        let mut install = command("cargo", &["install", "--quiet", "--locked", name, "--root"]);
        install.arg(&peers).arg("--target-dir").arg(peers.join("build"));
        peer(&peers, name, &mut [install]);
    }
    let venv = command("python3", &["-m", "venv", "target/peers/python"]);
    let pip = ["install", "--quiet", "--disable-pip-version-check", "modbus-proxy==0.8.0"];
    peer(&peers, "modbus-proxy", &mut [venv, command("target/peers/python/bin/pip", &pip)]);
    if std::env::var_os("MBUSD").is_none() {
        println!("mbusd does not take part: MBUSD does not name one");
    }
    let mut bench = test::bench(&["--quiet", "--package", "mobgate-linux", "--bench", "pty", "--"]);
    bench.args(choice.quick.then_some("--quick")).args(&choice.groups);
    run(bench.env("MOBGATE_PEERS", &peers))
}

/// Installs a peer once.
fn peer(peers: &Path, name: &str, commands: &mut [Command]) {
    let done = peers.join(format!("{}.installed", name.split('@').next().unwrap_or(name)));
    if done.exists() {
        return;
    }
    println!("installing {name}");
    for command in commands {
        let why = match command.output() {
            Ok(output) if output.status.success() => continue,
            Ok(output) => {
                let log = String::from_utf8_lossy(&output.stderr).into_owned();
                let error = log.lines().find(|line| line.starts_with("error")).or(log.lines().last());
                error.unwrap_or_default().to_owned()
            }
            Err(error) => error.to_string(),
        };
        println!("{name} cannot be installed: {why}");
        return;
    }
    // If this fails, only the next run is slower.
    let _ = std::fs::write(done, "");
}
