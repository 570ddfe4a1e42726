//! The developers' commands: `cargo xtask help` lists them. The programs they run are elsewhere; they know how to run them, and
//! their dependencies.

use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};

use install::Group;
use test::Suite;
use tools::{Outcome, command, run};

mod api;
mod board;
mod book;
mod figures;
mod fuzz;
mod habits;
mod install;
mod key;
mod parts;
mod peers;
mod release;
mod schemathesis;
mod sizes;
mod test;
mod tools;
mod under_load;
mod update;

/// Builds, tests and measures mobgate.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask")]
struct Arguments {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Installs what the tests need, and runs them
    Test {
        /// List what is missing instead of installing it
        #[arg(long)]
        no_install: bool,
        /// Of the STM32 boards only these, as `nucleo_h743zi`
        #[arg(long = "board", value_name = "BOARD")]
        boards: Vec<String>,
        /// Only these tests; torture, broker and maindevices run only if they are named
        #[arg(default_values = ["workspace", "browser", "package", "qemu", "qemu-browser", "rp2040", "stm32"])]
        suites: Vec<Suite>,
    },
    /// Installs what all commands need, or these groups: by apt-get, pip, npm and cargo
    Install {
        /// List what is missing instead
        #[arg(long)]
        no_install: bool,
        groups: Vec<Group>,
    },
    /// Checks formatting, subjects of commits, clippy's lints, the documentation and the rust-version
    Lint,
    /// Runs cargo for a board: `board nucleo_h743zi build`, `board core build` for the gateway's core alone
    Board {
        /// A folder of boards/, or `core`
        board: String,
        /// build, clippy, run, ...
        command: String,
        #[command(flatten)]
        words: Words,
    },
    /// Builds the STM32 images and prints their sections, largest symbols and budgets
    Sizes { boards: Vec<String> },
    /// Checks the Linux program for 64-bit and 32-bit ARM
    Arm {
        #[arg(default_values = ["aarch64-unknown-linux-gnu", "armv7-unknown-linux-gnueabihf"])]
        targets: Vec<String>,
    },
    /// Builds the Debian package
    Deb,
    /// Runs the emulated board among devices: `qemu figures` and `qemu roles` measure it, `qemu soak N` loads it
    #[command(disable_help_flag = true)]
    Qemu(Words),
    /// Sends this many random packets at each stage of an SSH connection to the emulated board
    Packets {
        #[arg(value_parser = clap::value_parser!(u64).range(1..))]
        count: u64,
    },
    /// Measures the gateway in virtual time
    #[command(disable_help_flag = true)]
    Bench(Words),
    /// Measures the Linux program on pseudo-terminals, in real time
    #[command(disable_help_flag = true)]
    Pty(Words),
    /// Counts instructions and system calls of the Linux program; `--no-run` only builds what does
    #[command(disable_help_flag = true)]
    Counts(Words),
    /// Measures third-party gateways beside mobgate, in one run
    Peers(peers::Choice),
    /// Tests the web interface with requests that schemathesis generates from docs/openapi.yaml
    Schemathesis(schemathesis::Choice),
    /// Runs libmodbus's own test suite through the gateway
    Libmodbus,
    /// Fuzzes each framing for this many seconds
    Fuzz {
        #[arg(value_parser = clap::value_parser!(u64).range(1..))]
        seconds: u64,
        #[arg(default_values = ["rtu", "ascii", "tcp"])]
        targets: Vec<String>,
    },
    /// Changes the code in small ways and names the changes that no test notices
    #[command(disable_help_flag = true)]
    Mutation(Words),
    /// Runs the tests that depend on the machine's clock many times, beside busy threads
    UnderLoad(under_load::Choice),
    /// Builds the documents as a book, after checking their links, tables and blocks
    Book {
        /// Only check
        #[arg(long)]
        check: bool,
    },
    /// Checks licences, bans and sources of all crates
    Deny,
    /// Checks the public items of the library crates against xtask/api
    Api {
        /// Write the lists instead
        #[arg(long)]
        write: bool,
    },
    /// Makes the key that signs updates, unless there is one: in this file, or in target/ for development; prints its public half
    Key { file: Option<std::path::PathBuf> },
    /// Builds a release: package, images, updates, SBOMs, checksums; MOBGATE_SIGNING_KEY names the file of its key
    Release {
        /// Without a look at the RustSec database, for practice: the folder is called so
        #[arg(long)]
        rehearsal: bool,
    },
    /// Builds boards' images here and in another folder, and compares them
    Reproducible { boards: Vec<String> },
    /// Compares the figures that commands printed into a file with those of a list
    Figures {
        file: std::path::PathBuf,
        #[arg(default_value = "tests/figures")]
        list: std::path::PathBuf,
    },
}

/// Arguments passed on unchanged.
#[derive(Args)]
struct Words {
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENT")]
    words: Vec<String>,
}

fn main() -> ExitCode {
    match carry_out(Arguments::parse().task) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("cargo xtask: {error}");
            ExitCode::FAILURE
        }
    }
}

fn carry_out(task: Task) -> Outcome {
    match task {
        Task::Test { no_install, boards, suites } => test::run_all(&suites, &boards, !no_install),
        Task::Install { no_install, groups } => install::all(&groups, !no_install),
        Task::Lint => habits::lint(),
        Task::Board { board, command, words } => board::run(&board, &command, &words.words),
        Task::Sizes { boards } => sizes::print(&boards),
        Task::Arm { targets } => board::arm(&targets),
        Task::Deb => test::deb().map(drop),
        Task::Qemu(Words { words }) => run(&mut command(test::build("mobgate-qemu")?, &words)),
        Task::Packets { count } => {
            let test = ["--test", "qemu", "--", "--nocapture", "ssh::random"];
            run(test::tests(&test).env("MOBGATE_PACKETS", count.to_string()))
        }
        Task::Bench(Words { words }) => run(&mut test::figures(&words)),
        Task::Pty(Words { words }) => {
            run(test::bench(&["--package", "mobgate-linux", "--bench", "pty", "--"]).args(words))
        }
        Task::Counts(Words { words }) => {
            install::check(&[Group::Counts])?;
            // The program as it is packaged; who measures it is built as for the tests.
            let program = test::packaged()?;
            let mut harness = test::tests(&["--bench", "pty"]);
            if words == ["--no-run"] {
                harness.arg("--no-run");
            } else {
                harness.env("MOBGATE_PROGRAM", program).args(["--", "counts", "refusals"]).args(words);
            }
            run(&mut harness)
        }
        Task::Peers(choice) => peers::measure(&choice),
        Task::Schemathesis(choice) => schemathesis::ask(&choice),
        Task::Libmodbus => run(&mut command("tests/peers/libmodbus", &[""; 0])),
        Task::Fuzz { seconds, targets } => fuzz::all(seconds, &targets),
        Task::Mutation(Words { words }) => run(&mut command(test::build("mobgate-mutants")?, &words)),
        Task::UnderLoad(choice) => under_load::run_all(&choice),
        Task::Book { check } => book::make(check),
        Task::Deny => habits::deny(),
        Task::Api { write } => api::check(write),
        Task::Key { file } => make_key(file),
        Task::Release { rehearsal } => release::build(rehearsal),
        Task::Reproducible { boards } => release::reproducible(&boards),
        Task::Figures { file, list } => figures::hold(&file, &list),
    }
}

fn make_key(file: Option<std::path::PathBuf>) -> Outcome {
    let file = file.unwrap_or_else(key::development);
    println!("{}: public half {}", file.display(), key::Key::made(&file)?.public());
    Ok(())
}
