//! Serial lines: pairs of PTYs, with one of the servers at the far end.

use std::ffi::OsString;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;

use crate::common::{Program, wait_for};
use crate::outside::{Running, Tool, script};
use crate::{rmodbus_server, tokio_server};

/// Input register 0 of this unit; the following ones count up.
pub(crate) fn first_input(unit: u8) -> u16 {
    u16::from(unit) << 8
}

/// A line with a server on it, for as long as it is held.
pub(crate) struct Line {
    folder: tempfile::TempDir,
    /// How long the gateway waits for a response.
    timeout: &'static str,
    _programs: Vec<Running>,
}

/// An interpreter beside other tests on a busy machine may be slow.
const PYTHON_TIMEOUT: &str = "5s";
/// Short, because tests wait for units that do not respond.
const RUST_TIMEOUT: &str = "1s";

impl Line {
    /// `units` played by pymodbus.
    pub(crate) fn with_pymodbus(units: &[u8]) -> Self {
        let mut line = Self::bare();
        line._programs.push(pymodbus(line.far_end().into(), units));
        line.timeout = PYTHON_TIMEOUT;
        line
    }

    /// `unit` played by rmodbus; other units are silent.
    pub(crate) fn with_rmodbus(unit: u8) -> Self {
        let line = Self::bare();
        rmodbus_server::start(&line.far_end(), unit);
        line
    }

    /// `unit` played by tokio-modbus; other units are silent.
    pub(crate) fn with_tokio_modbus(unit: u8) -> Self {
        let line = Self::bare();
        tokio_server::start(&line.far_end(), unit);
        line
    }

    /// Nobody at the far end.
    pub(crate) fn without_server() -> Self {
        Self::bare()
    }

    fn bare() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let end = |name| format!("pty,raw,echo=0,link={}", folder.path().join(name).display()).into();
        let socat = Tool::socat().start([end("near"), end("far")]);
        let line = Self { folder, timeout: RUST_TIMEOUT, _programs: vec![socat] };
        wait_for("socat's PTYs", || (line.near_end().exists() && line.far_end().exists()).then_some(()));
        line
    }

    /// The gateway's end.
    pub(crate) fn near_end(&self) -> PathBuf {
        self.folder.path().join("near")
    }

    pub(crate) fn far_end(&self) -> PathBuf {
        self.folder.path().join("far")
    }
}

/// `units` played by pymodbus at a serial device, at `tcp:PORT` or `rtu:PORT`.
pub(crate) fn pymodbus(at: OsString, units: &[u8]) -> Running {
    let mut arguments = vec![script("server.py").into(), at];
    arguments.extend(units.iter().map(|unit| unit.to_string().into()));
    ready(Tool::python().start(arguments), "pymodbus's server")
}

/// `unit` played by modbus-serial at a TCP port.
pub(crate) fn modbus_serial(port: u16, unit: u8) -> Running {
    let arguments = [port.to_string().into(), unit.to_string().into()];
    let script = script("node/server.js").into();
    ready(Tool::node().start([script].into_iter().chain(arguments)), "modbus-serial's server")
}

/// The server, once it says that it listens.
fn ready(mut server: Running, name: &str) -> Running {
    let mut said = String::new();
    BufReader::new(server.0.stdout.as_mut().unwrap()).read_line(&mut said).unwrap();
    assert_eq!(said, "ready\n", "{name}");
    server
}

/// The program with `lines` as its ports P1, P2 and so on, a TCP server P502, and `routes`. The lines are open.
pub(crate) fn program(lines: &[Line], routes: &str) -> Program {
    let port = |(index, line): (usize, &Line)| {
        let (device, timeout) = (line.near_end(), line.timeout);
        // Nothing has been asked on these lines before: what comes at the start need not be discarded for as long.
        let line = format!("rtu client 115200 8N1 timeout {timeout} late-window 200ms");
        format!("port P{} serial {} {line}\n", index + 1, device.display())
    };
    let ports: String = lines.iter().enumerate().map(port).collect();
    let program = Program::configured(&format!("{ports}port P502 tcp server {{port}}\n{routes}"));
    wait_for("the lines", || (program.log().matches("is open").count() == lines.len()).then_some(()));
    program
}
