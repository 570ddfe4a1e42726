//! Repository checks: licences and sources of crates, the Rust version, the editor's projects.

use std::path::PathBuf;

use crate::install::{self, Group};
use crate::test;
use crate::tools::{Outcome, built, cargo, command, output, program, read, root, run};

/// Packages of tests/ that are workspaces of their own.
const TESTS: [&str; 2] = ["tests/fuzz", "tests/stm32"];

/// Folders of boards/ and tests/ that have this file, in the order of their names.
fn folders_with(file: &str) -> Outcome<Vec<PathBuf>> {
    let boards = root().join("boards").read_dir().map_err(|error| format!("boards/: {error}"))?;
    let folders = boards.flatten().map(|entry| entry.path()).chain(TESTS.map(|folder| root().join(folder)));
    let mut with: Vec<PathBuf> = folders.filter(|folder| folder.join(file).exists()).collect();
    with.sort();
    Ok(with)
}

/// Folders of boards/ and tests/ with their own workspace.
fn workspaces() -> Outcome<Vec<PathBuf>> {
    folders_with("Cargo.lock")
}

/// Checks licences, bans and sources of all crates, in the workspace and each board: see deny.toml.
pub(crate) fn deny() -> Outcome {
    install::check(&[Group::Deny])?;
    cargo_deny(&["bans", "licenses", "sources"])
}

/// The same, for these checks of cargo-deny.
pub(crate) fn cargo_deny(checks: &[&str]) -> Outcome {
    for folder in std::iter::once(root().to_owned()).chain(workspaces()?) {
        let mut deny =
            command("cargo-deny", &["--locked", "--workspace", "--config", "deny.toml", "--manifest-path"]);
        run(deny.arg(folder.join("Cargo.toml")).arg("check").args(checks))?;
    }
    Ok(())
}

/// Checks the workspace with the oldest supported Rust, unless that is the one in use.
pub(crate) fn rust_version() -> Outcome {
    let manifest = read("Cargo.toml")?;
    let line = manifest.lines().find(|line| line.starts_with("rust-version = "));
    let wanted = line.and_then(|line| line.split('"').nth(1)).ok_or("Cargo.toml has no rust-version")?;
    for folder in workspaces()? {
        let own = read(folder.join("Cargo.toml"))?;
        if own.contains("rust-version = \"") && !own.contains(&format!("rust-version = \"{wanted}\"")) {
            return Err(format!("{} has another rust-version than {wanted}", folder.display()));
        }
    }
    let used = output(&mut command("rustc", &["--version"]))?;
    if used.split(' ').nth(1).is_some_and(|version| version.starts_with(&format!("{wanted}."))) {
        println!("rust-version {wanted} is the Rust in use: {}", used.trim());
        return Ok(());
    }
    if program("rustup").is_none() {
        return Err(format!(
            "rust-version {wanted} is not built by {}, and there is no rustup for another",
            used.trim()
        ));
    }
    println!("rust-version {wanted} is not the Rust in use; rustup brings it if it is not here");
    let mut check = command("rustup", &["run", "--install", wanted, "cargo", "check", "--locked"]);
    check.args(["--workspace", "--all-targets", "--target-dir", "target/rust-version"]);
    run(check.env_remove("RUSTUP_TOOLCHAIN").env_remove("RUSTC"))
}

/// Checks the subjects of the last fifty commits, as CONTRIBUTING.md wants them. A copy without its history has none.
fn subjects() -> Outcome {
    if !root().join(".git").exists() || program("git").is_none() {
        println!("no history here: the subjects of commits are not checked");
        return Ok(());
    }
    // Whoever the files belong to.
    let words = ["-c", "safe.directory=*", "log", "--no-merges", "--max-count=50", "--format=%s"];
    let log = output(command("git", &words).current_dir(root()))?;
    let is_good = |subject: &str| subject.chars().count() <= 72 && subject.contains(": ");
    match log.lines().find(|subject| !is_good(subject)) {
        Some(subject) => Err(format!("a commit is not `part: what` of at most 72 characters: {subject}")),
        None => Ok(()),
    }
}

/// Checks the formatting of all packages, the subjects of commits, lints and docs of the workspace's, the editor's projects, and the Rust version.
pub(crate) fn lint() -> Outcome {
    run(&mut command("cargo", &["fmt", "--all", "--check"]))?;
    for package in folders_with("Cargo.toml")? {
        run(command("cargo", &["fmt", "--check"]).current_dir(&package))
            .map_err(|error| format!("{}: {error}", package.display()))?;
    }
    subjects()?;
    linked_projects()?;
    rust_version()?;
    run(&mut cargo("clippy", &["--workspace", "--all-targets", "--", "-D", "warnings"]))?;
    // The program as packaged, with what else the workspace has: its dependencies are checked already. The package whose tests
    // want the program would have it with all features.
    let packaged = "--workspace --exclude mobgate-ssh --bins --test structure --no-default-features";
    let packaged: Vec<_> = packaged.split(' ').collect();
    run(cargo("clippy", &packaged).args(["--", "-D", "warnings"]))?;
    test::lint_stm32()?;
    run(cargo("doc", &["--workspace", "--no-deps"]).env("RUSTDOCFLAGS", "-Dwarnings"))?;
    built("target/doc/mobgate/index.html")
}

/// Checks that rust-analyzer knows the packages outside the workspace.
fn linked_projects() -> Outcome {
    let settings = read(".vscode/settings.json")?;
    for folder in workspaces()? {
        let manifest = folder.strip_prefix(root()).unwrap_or(&folder).join("Cargo.toml");
        if !settings.contains(&format!("\"{}\"", manifest.display())) {
            return Err(format!(
                "rust-analyzer.linkedProjects in .vscode/settings.json lacks {}",
                manifest.display()
            ));
        }
    }
    Ok(())
}
