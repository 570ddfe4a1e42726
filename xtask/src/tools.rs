//! Runs commands from the repository's root, and prints figures.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The error is a message for people.
pub(crate) type Outcome<T = ()> = Result<T, String>;

/// The repository's root.
pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap_or(Path::new("."))
}

/// A command at the repository's root, without the environment that `cargo run` sets for this package.
pub(crate) fn command<A: AsRef<OsStr>>(program: impl AsRef<OsStr>, arguments: &[A]) -> Command {
    let mut command = Command::new(program);
    command.current_dir(root()).args(arguments);
    for (name, _) in std::env::vars_os() {
        let text = name.to_string_lossy();
        if ["CARGO_PKG_", "CARGO_MANIFEST_", "CARGO_BIN_", "LD_LIBRARY_PATH"]
            .iter()
            .any(|of| text.starts_with(of))
        {
            command.env_remove(&name);
        }
    }
    command
}

/// `cargo` with these arguments, locked to the lock file.
pub(crate) fn cargo<A: AsRef<OsStr>>(subcommand: &str, arguments: &[A]) -> Command {
    let mut cargo = command("cargo", &[subcommand, "--locked"]);
    cargo.args(arguments);
    cargo
}

/// The command as typed in a shell.
pub(crate) fn line(command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    words.map(|word| word.to_string_lossy().into_owned()).collect::<Vec<_>>().join(" ")
}

/// Runs the command, with its output on this terminal.
pub(crate) fn run(command: &mut Command) -> Outcome {
    let text = line(command);
    match command.status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(format!("{text}: {status}")),
        Err(error) => Err(format!("{text}: {error}")),
    }
}

/// The command's output; its errors go to this terminal.
pub(crate) fn output(command: &mut Command) -> Outcome<String> {
    let text = line(command);
    let output = command.stderr(Stdio::inherit()).output().map_err(|error| format!("{text}: {error}"))?;
    if !output.status.success() {
        return Err(format!("{text}: {}", output.status));
    }
    String::from_utf8(output.stdout).map_err(|error| format!("{text}: {error}"))
}

/// Whether the command succeeds; its output is discarded.
pub(crate) fn succeeds(command: &mut Command) -> bool {
    command.stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok_and(|status| status.success())
}

/// Finds a program in PATH.
pub(crate) fn program(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path).map(|folder| folder.join(name)).find(|file| file.is_file())
}

/// Reads a text file of the repository.
pub(crate) fn read(path: impl AsRef<Path>) -> Outcome<String> {
    let path = root().join(path);
    std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))
}

/// Writes a file.
pub(crate) fn written(path: PathBuf, bytes: &[u8]) -> Outcome<PathBuf> {
    std::fs::write(&path, bytes).map_err(|error| fault(&path, &error))?;
    Ok(path)
}

/// What went wrong with a file.
pub(crate) fn fault(path: &Path, what: &dyn std::fmt::Display) -> String {
    format!("{}: {what}", path.display())
}

/// Reports a build product, or fails if it does not exist.
pub(crate) fn built(path: impl AsRef<Path>) -> Outcome {
    let path = path.as_ref();
    let shown = path.strip_prefix(root()).unwrap_or(path).display();
    if !path.exists() {
        return Err(format!("{shown} was not built"));
    }
    println!("built {shown}");
    Ok(())
}

/// Prints a figure, and whether it is within its upper limit.
pub(crate) fn figure(name: &str, value: f64, unit: &str, most: Option<f64>) {
    let wanted = most.map_or("-".to_owned(), |most| format!("<={most}"));
    let verdict = if most.is_some_and(|most| value > most) { "short" } else { "ok" };
    let value = (value * 100.0).round() / 100.0;
    println!("figure {name} {value} {unit} {wanted} {verdict}");
}
