//! The tests, in the order in which they are quick.

use clap::ValueEnum;

use crate::install::{self, Group};
use crate::tools::{Outcome, built, cargo, command, output, program, run};

/// Tests that need the same things.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Suite {
    /// All packages of the workspace, and the core without its features
    Workspace,
    /// The emulated board
    Qemu,
    /// The Debian package, installed, used and removed (needs root)
    Package,
    /// Random worlds, many times as many as in `workspace`
    Torture,
    /// EtherCAT: MainDevices by others, thousands of cycles and starts, and what conformance is measured by
    Maindevices,
}

impl Suite {
    fn needs(self) -> &'static [Group] {
        match self {
            Self::Workspace | Self::Maindevices => &[Group::Peers],
            Self::Qemu => &[Group::Qemu, Group::Thumb, Group::Peers],
            Self::Package => &[Group::Package],
            Self::Torture => &[],
        }
    }
}

/// Runs these, after what they need has been installed or named.
pub(crate) fn run_all(suites: &[Suite], install: bool) -> Outcome {
    // Said before the others have taken their time.
    if suites.contains(&Suite::Package) && !may_be_root()? {
        return Err(
            "the package test needs root, or sudo; the others: cargo xtask test workspace qemu".into()
        );
    }
    let mut groups: Vec<Group> = suites.iter().flat_map(|suite| suite.needs()).copied().collect();
    groups.dedup();
    // No groups would mean all of them.
    if !groups.is_empty() {
        install::all(&groups, install)?;
    }
    suites.iter().try_for_each(|suite| match suite {
        Suite::Workspace => {
            run(&mut cargo("test", &["--workspace"]))?;
            // As the boards without EtherCAT are built, but for IPv6: without data points and captures.
            let core = ["--package", "mobgate", "--lib", "--no-default-features", "--features", "ipv6"];
            run(&mut cargo("test", &core))
        }
        Suite::Qemu => run(&mut cargo("test", &["--package", "mobgate-qemu", "--test", "qemu"])),
        Suite::Package => {
            deb()?;
            // Its demo is the device behind the package's gateway.
            run(&mut cargo("build", &["--package", "mobgate-linux", "--bin", "mobgate"]))?;
            run(&mut command("tests/package/run", &[""; 0]))
        }
        // Optimised, since a debug build takes a quarter of an hour for them.
        Suite::Torture => {
            let tests = ["--profile", "torture", "--test", "gateway", "--test", "ethercat", "torture"];
            run(cargo("test", &tests)
                .args(["--", "--nocapture", "--test-threads=2"])
                .env("MOBGATE_SEEDS", "4000"))
        }
        Suite::Maindevices => {
            main_devices("1", &["foreign::pysoem", "foreign::soemx", "foreign::in_process"])?;
            // It starts in 0.4 s, where the others take milliseconds, and waits most of that time.
            main_devices("2", &["foreign::kickcat"])?;
            // What else an integrator is promised, with its figures.
            main_devices(
                "1",
                &["chip_resets", "the_suite_passes", "statement_58", "statement_39", "thirty_two"],
            )
        }
    })
}

/// Whether this is root, or can be by sudo.
fn may_be_root() -> Outcome<bool> {
    let is_root = output(&mut command("id", &["-u"]))?.trim() == "0";
    Ok(is_root || program("sudo").is_some())
}

/// Each exchanges process data 100 000 times and starts 500 times, without failing once; so many run at a time.
fn main_devices(at_a_time: &str, tests: &[&str]) -> Outcome {
    let mut cargo = cargo("test", &["--test", "ethercat", "--", "--nocapture", "--test-threads", at_a_time]);
    run(cargo.args(tests).env("MOBGATE_CYCLES", "100000").env("MOBGATE_RESTARTS", "500"))
}

/// Builds the Debian package.
pub(crate) fn deb() -> Outcome {
    install::check(&[Group::Package])?;
    let printed = output(&mut command(
        "cargo",
        &["deb", "--quiet", "--locked", "--strip", "--package", "mobgate-linux"],
    ))?;
    built(printed.lines().last().unwrap_or_default())
}
