//! The test suites, fastest first.

use std::path::{Path, PathBuf};
use std::process::Command;

use clap::ValueEnum;

use crate::install::{self, Group};
use crate::tools::{Outcome, built, cargo, command, output, program, root, run};
use crate::{board, release};

/// Tests with the same requirements.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Suite {
    /// All packages of the workspace, and the core without its features
    Workspace,
    /// The emulated board
    Qemu,
    /// The STM32 boards' images in an emulator
    Stm32,
    /// The RP2040 boards' image in an emulator (needs root)
    Rp2040,
    /// The Debian package, installed, used and removed (needs root)
    Package,
    /// The web interface's page in a browser
    Browser,
    /// The same page on the emulated board
    QemuBrowser,
    /// Random worlds, many times more than in `workspace`
    Torture,
    /// mosquitto under load, killed a hundred times
    Broker,
    /// EtherCAT: third-party MainDevices, thousands of cycles and restarts, and the conformance measurements
    Maindevices,
}

impl Suite {
    fn needs(self) -> &'static [Group] {
        match self {
            Self::Workspace | Self::Broker | Self::Maindevices => &[Group::Peers],
            Self::Qemu => &[Group::Qemu, Group::Thumb, Group::Peers],
            Self::Stm32 => &[Group::Stm32, Group::Thumb],
            Self::Rp2040 => &[Group::Rp2040, Group::Thumb],
            Self::Package => &[Group::Package],
            Self::Browser => &[Group::Browser],
            Self::QemuBrowser => &[Group::Qemu, Group::Thumb, Group::Browser],
            Self::Torture => &[],
        }
    }
}

/// Runs these suites, after installing or listing what they need; of the STM32 boards only `boards`, or all if none are given.
pub(crate) fn run_all(suites: &[Suite], boards: &[String], install: bool) -> Outcome {
    if !boards.is_empty() && !suites.contains(&Suite::Stm32) {
        return Err("--board chooses among the boards of the suite stm32, which is not asked for".into());
    }
    let nucleos = board::nucleos()?;
    if let Some(unknown) = boards.iter().find(|board| !nucleos.contains(board)) {
        return Err(format!("no STM32 board {unknown}; there are {}", nucleos.join(", ")));
    }
    // Checked first, before the other suites take their time.
    let as_root = |suite: &Suite| matches!(suite, Suite::Package | Suite::Rp2040);
    if suites.iter().any(as_root) && !may_be_root()? {
        return Err(
            "the tests package and rp2040 need root, or sudo; without it: cargo xtask test workspace browser qemu qemu-browser stm32"
                .into(),
        );
    }
    let mut groups: Vec<Group> = suites.iter().flat_map(|suite| suite.needs()).copied().collect();
    groups.sort();
    groups.dedup();
    // An empty list would mean all groups.
    if !groups.is_empty() {
        install::all(&groups, install)?;
    }
    suites.iter().try_for_each(|suite| run_one(*suite, boards))
}

fn run_one(suite: Suite, boards: &[String]) -> Outcome {
    match suite {
        Suite::Workspace => {
            run(&mut tests(&[]))?;
            // The feature set of boards without EtherCAT, plus IPv6: no data points, no captures; and data points as boards have them.
            ["ipv6", "ipv6,points"].iter().try_for_each(|features| {
                let core = ["--package", "mobgate", "--lib", "--no-default-features", "--features", features];
                run(&mut cargo("test", &core))
            })
        }
        Suite::Qemu => run(&mut tests(&["--test", "qemu"])),
        Suite::Stm32 => emulated(boards),
        Suite::Rp2040 => {
            board::RP2040.iter().try_for_each(|board| board::run(board, "build", &[]))?;
            // In a network of its own.
            let root = if is_root()? { "env" } else { "sudo" };
            run(&mut command(root, &["tests/rp2040/run", "tests/rp2040/test.js"]))
        }
        Suite::Package => {
            deb()?;
            // Its demo is the device behind the packaged gateway.
            build("mobgate")?;
            run(&mut command("tests/package/run", &[""; 0]))
        }
        // With its figures; the pictures are in target/browser.
        Suite::Browser => {
            let words =
                ["--test", "browser", "--test", "web", "--", "--nocapture", "in_a_browser", "the_page"];
            run(&mut tests(&words))
        }
        Suite::QemuBrowser => run(&mut tests(&["--test", "qemu_browser", "--", "--nocapture"])),
        Suite::Torture => {
            let words = [
                "--test",
                "gateway",
                "--test",
                "ethercat",
                "torture",
                "--",
                "--nocapture",
                "--test-threads=2",
            ];
            run(tests(&words).env("MOBGATE_SEEDS", "4000"))
        }
        Suite::Broker => {
            let words = ["--test", "peers", "--", "--nocapture", "the_broker_is_killed"];
            run(tests(&words).env("MOBGATE_KILLS", "100"))
        }
        Suite::Maindevices => {
            main_devices("1", &["foreign::pysoem", "foreign::soemx", "foreign::in_process"])?;
            // Its start takes 0.4 s, most of it waiting, where the others take milliseconds: two at a time.
            main_devices("2", &["foreign::kickcat"])?;
            // The other promises to integrators, with their figures.
            main_devices(
                "1",
                &["chip_resets", "the_suite_passes", "statement_58", "statement_39", "thirty_two"],
            )
        }
    }
}

/// Tests of the workspace. One package alone would have its dependencies compiled once more, with fewer features.
pub(crate) fn tests(words: &[&str]) -> Command {
    let mut cargo = cargo("test", &["--workspace"]);
    cargo.args(words);
    cargo
}

/// Builds a program of the workspace, likewise.
pub(crate) fn build(name: &str) -> Outcome<PathBuf> {
    // Beside a test it has the dependencies that tests have, or else these would be compiled once more.
    run(&mut cargo("build", &["--quiet", "--workspace", "--test", "structure", "--bin", name]))?;
    Ok(root().join("target/debug").join(name))
}

/// Builds the images of these STM32 boards, or of all if none are given, and runs them in the emulator.
fn emulated(boards: &[String]) -> Outcome {
    let is_tested = |board: &String| boards.is_empty() || boards.contains(board);
    let (tested, others): (Vec<_>, Vec<_>) = board::nucleos()?.into_iter().partition(is_tested);
    tested.iter().try_for_each(|board| board::build_all(board))?;
    // With its figures. Tests have a chip in their names: f429 is that of the nucleo_f429zi.
    let mut cargo = stm32("test");
    cargo.args(["--", "--nocapture"]);
    for board in &others {
        cargo.arg("--skip").arg(board.trim_start_matches("nucleo_").trim_end_matches("zi"));
    }
    run(&mut cargo)
}

/// cargo for the emulator of the STM32 boards, a workspace of its own.
fn stm32(subcommand: &str) -> Command {
    let place = ["--manifest-path", "tests/stm32/Cargo.toml", "--target-dir", "target/stm32"];
    cargo(subcommand, &place)
}

/// Lints it where it can be built, and says where it cannot.
pub(crate) fn lint_stm32() -> Outcome {
    match install::check(&[Group::Stm32]) {
        Ok(()) => run(stm32("clippy").args(["--all-targets", "--", "-D", "warnings"])),
        Err(missing) => {
            println!("tests/stm32 is not linted: {missing}");
            Ok(())
        }
    }
}

/// Whether this is root, or sudo is available.
fn may_be_root() -> Outcome<bool> {
    Ok(is_root()? || program("sudo").is_some())
}

fn is_root() -> Outcome<bool> {
    Ok(output(&mut command("id", &["-u"]))?.trim() == "0")
}

/// Each test exchanges process data 100 000 times and restarts 500 times, without a single failure; `at_a_time` run in parallel.
fn main_devices(at_a_time: &str, tests: &[&str]) -> Outcome {
    let mut cargo = self::tests(&["--test", "ethercat", "--", "--nocapture", "--test-threads", at_a_time]);
    run(cargo.args(tests).env("MOBGATE_CYCLES", "100000").env("MOBGATE_RESTARTS", "500"))
}

/// A benchmark of what a user has, with the dependencies of the Debian package: with other flags they would be compiled once more.
pub(crate) fn bench(words: &[&str]) -> Command {
    let mut cargo = cargo("bench", &["--profile", "release"]);
    short_paths(&mut cargo).args(words);
    cargo
}

/// The figures in virtual time, and with valgrind those of the instructions of groups that are named.
pub(crate) fn figures(groups: &[String]) -> Command {
    let package = ["--package", "mobgate-benches", "--"];
    let counts = groups.iter().any(|group| group.ends_with("_instructions"));
    let mut cargo = if counts { bench(&package) } else { cargo("bench", &package) };
    cargo.args(groups);
    cargo
}

/// Lets cargo build the same wherever it is.
fn short_paths(cargo: &mut Command) -> &mut Command {
    let flags =
        board::remapped(Path::new("rustc")).map(|path| format!("--remap-path-prefix={}/=", path.display()));
    // Separated as cargo wants it, for folders with spaces.
    cargo.env("CARGO_ENCODED_RUSTFLAGS", flags.collect::<Vec<_>>().join("\x1f"))
}

/// Builds the program as the Debian package has it, by the same compilation.
pub(crate) fn packaged() -> Outcome<PathBuf> {
    let words = ["--quiet", "--release", "--package", "mobgate-linux", "--no-default-features"];
    run(short_paths(&mut cargo("build", &words)).envs(release::date()))?;
    Ok(root().join("target/release/mobgate"))
}

/// Builds the Debian package, the same wherever it is built.
pub(crate) fn deb() -> Outcome<PathBuf> {
    install::check(&[Group::Package])?;
    let mut cargo =
        command("cargo", &["deb", "--quiet", "--locked", "--strip", "--package", "mobgate-linux"]);
    let printed = output(short_paths(&mut cargo).envs(release::date()))?;
    let package = root().join(printed.lines().last().unwrap_or_default());
    built(&package)?;
    Ok(package)
}
