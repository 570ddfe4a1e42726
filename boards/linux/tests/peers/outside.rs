//! Outside programs: how they are found, run, and asked for when they are missing.

use std::env;
use std::ffi::OsString;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// An outside program that a test needs.
pub(crate) struct Tool {
    program: OsString,
    install: String,
}

impl Tool {
    pub(crate) fn mbpoll() -> Self {
        Self { program: "mbpoll".into(), install: "apt-get install mbpoll".into() }
    }

    pub(crate) fn socat() -> Self {
        Self { program: "socat".into(), install: "apt-get install socat".into() }
    }

    /// The broker. Debian installs it where only root looks.
    pub(crate) fn mosquitto() -> Self {
        let found = ["/usr/sbin/mosquitto", "/usr/local/sbin/mosquitto"]
            .into_iter()
            .find(|path| Path::new(path).exists());
        Self { program: found.unwrap_or("mosquitto").into(), install: "apt-get install mosquitto".into() }
    }

    /// One of its clients.
    pub(crate) fn mosquitto_client(program: &str) -> Self {
        Self { program: program.into(), install: "apt-get install mosquitto-clients".into() }
    }

    /// A Python that has pymodbus and others: the one that `MOBGATE_PYTHON` names, or else the virtual environment's.
    pub(crate) fn python() -> Self {
        let prepared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/python/bin/python3");
        let python = Self {
            program: env::var_os("MOBGATE_PYTHON").unwrap_or(prepared.into()),
            install: "cargo xtask install peers".into(),
        };
        let (good, said) = python
            .run(&["-c", "import jsonschema_rs, google.protobuf, paho.mqtt.client, prometheus_client, pymodbus.simulator, serial, sunspec2"]);
        assert!(
            good,
            "jsonschema-rs, paho-mqtt, prometheus-client, protobuf, pymodbus, pyserial or pysunspec2 is missing: {}\n{said}",
            python.install
        );
        python
    }

    /// A Node.js; its packages are those that `cargo xtask install peers` has installed.
    pub(crate) fn node() -> Self {
        let installed =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/node/node_modules/modbus-serial");
        let install = "cargo xtask install peers";
        assert!(installed.exists(), "modbus-serial is missing: {install}");
        Self { program: "node".into(), install: install.into() }
    }

    fn command(&self) -> Command {
        Command::new(&self.program)
    }

    /// Runs it to its end; both outputs, and whether it ended well.
    pub(crate) fn run(&self, arguments: &[&str]) -> (bool, String) {
        let ended = self.command().args(arguments).stdin(Stdio::null()).output();
        let output = ended.unwrap_or_else(|error| self.missing(&error));
        let text = [output.stdout, output.stderr].concat();
        (output.status.success(), String::from_utf8_lossy(&text).into_owned())
    }

    /// Starts it, with its standard output to be read.
    pub(crate) fn start(&self, arguments: impl IntoIterator<Item = OsString>) -> Running {
        let started = self.command().args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).spawn();
        Running(started.unwrap_or_else(|error| self.missing(&error)))
    }

    /// Starts it, with its standard input to be written as well.
    pub(crate) fn start_with_input(&self, arguments: impl IntoIterator<Item = OsString>) -> Running {
        let mut command = self.command();
        let started = command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
        Running(started.unwrap_or_else(|error| self.missing(&error)))
    }

    fn missing(&self, error: &std::io::Error) -> ! {
        match error.kind() {
            ErrorKind::NotFound => panic!("{} is missing: {}", self.program.display(), self.install),
            _ => panic!("{}: {error}", self.program.display()),
        }
    }
}

/// Prometheus's tool: the installed one, or that of the package that `cargo xtask install peers` has unpacked.
pub(crate) fn promtool() -> PathBuf {
    let unpacked = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/promtool/usr/bin/promtool");
    let found = env::var_os("PATH").and_then(|path| {
        env::split_paths(&path).map(|folder| folder.join("promtool")).find(|program| program.exists())
    });
    let program = found.unwrap_or(unpacked);
    assert!(program.exists(), "promtool is missing: cargo xtask install peers");
    program
}

/// A running outside program, which ends with the test.
pub(crate) struct Running(pub(crate) Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A file beside this one.
pub(crate) fn script(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers").join(name)
}
