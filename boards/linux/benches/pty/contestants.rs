//! The gateways that are measured, and how each is told what stands behind it.
//!
//! `MOBGATE_PEERS` names the folder into which `benches/peers/run` has installed what the package registries have, `MBUSD` an
//! mbusd. Every one listens on the loopback address only, and gets the same line settings and time-out as mobgate; pauses and
//! the like stay as they come, but for mbusd, which runs a second time with the shortest pause that it takes.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::common::mobgate;
use crate::line::Pace;

/// A gateway.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Contestant {
    Mobgate,
    Mbusd,
    MbusdShortPause,
    ModbusRelay,
    ModbusGateway,
    ModbusProxy,
    ModbusProxyRs,
}

/// What stands behind a gateway.
#[derive(Clone, Copy)]
pub(crate) enum Behind<'a> {
    /// A serial line, and how long its units may take to answer.
    Line { device: &'a str, pace: Pace, timeout_ms: u32 },
    /// A server on this machine.
    Tcp(u16),
}

impl Contestant {
    pub(crate) const ALL: [Self; 7] = [
        Self::Mobgate,
        Self::Mbusd,
        Self::MbusdShortPause,
        Self::ModbusRelay,
        Self::ModbusGateway,
        Self::ModbusProxy,
        Self::ModbusProxyRs,
    ];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Mobgate => "mobgate",
            Self::Mbusd => "mbusd",
            Self::MbusdShortPause => "mbusd, 1 ms pause",
            Self::ModbusRelay => "modbus-relay",
            Self::ModbusGateway => "modbus-gateway",
            Self::ModbusProxy => "modbus-proxy",
            Self::ModbusProxyRs => "modbus-proxy-rs",
        }
    }

    /// Whether it can have that behind it at all.
    pub(crate) fn takes(self, behind: Behind<'_>) -> bool {
        match behind {
            Behind::Line { .. } => !matches!(self, Self::ModbusProxy | Self::ModbusProxyRs),
            Behind::Tcp(_) => !matches!(self, Self::Mbusd | Self::MbusdShortPause | Self::ModbusRelay),
        }
    }

    /// The command that starts it, with its settings in `folder`; an error when it is not there.
    pub(crate) fn command(self, behind: Behind<'_>, folder: &Path, port: u16) -> Result<Command, String> {
        // Two of them look at the ending.
        let settings = folder.join("settings.yaml");
        fs::write(&settings, self.settings(behind, folder, port)).map_err(|error| error.to_string())?;
        let mut command = match self {
            Self::Mobgate => mobgate(),
            _ => Command::new(self.executable()?),
        };
        command.stdin(Stdio::null()).stdout(Stdio::null()).current_dir(folder);
        match self {
            Self::Mobgate => command.arg("--config").arg(settings).args(["--console", "off"]),
            Self::Mbusd | Self::MbusdShortPause => {
                command.args(["-d", "-v", "0", "-L", "-", "-c"]).arg(settings)
            }
            Self::ModbusRelay | Self::ModbusProxyRs => command.arg("-c").arg(settings),
            Self::ModbusGateway => command.args(["run", "--no-tui", "-c"]).arg(settings),
            Self::ModbusProxy => command.args(proxy_arguments(behind, port)),
        };
        Ok(command)
    }

    fn executable(self) -> Result<PathBuf, String> {
        let of_mbusd = matches!(self, Self::Mbusd | Self::MbusdShortPause);
        let variable = if of_mbusd { "MBUSD" } else { "MOBGATE_PEERS" };
        let path = env::var_os(variable).map(PathBuf::from).ok_or(format!("{variable} is not set"))?;
        let path = match self {
            Self::Mobgate | Self::Mbusd | Self::MbusdShortPause => path,
            Self::ModbusProxy => path.join("python/bin/modbus-proxy"),
            Self::ModbusRelay | Self::ModbusGateway | Self::ModbusProxyRs => path.join("bin").join(self.name()),
        };
        if path.exists() { Ok(path) } else { Err(format!("{} is not there", path.display())) }
    }

    fn settings(self, behind: Behind<'_>, folder: &Path, port: u16) -> String {
        let folder = folder.display();
        match (self, behind) {
            (Self::Mobgate, Behind::Line { device, pace, timeout_ms }) => {
                let gap = if pace.silence.is_zero() { "gap 0ms" } else { "" };
                format!(
                    "port P1 serial {device} rtu client {} 8N2 timeout {timeout_ms}ms {gap}\n\
                     port P502 tcp server 127.0.0.1:{port} clients 64\nroute P502 * * * P1\n",
                    pace.baud
                )
            }
            (Self::Mobgate, Behind::Tcp(server)) => format!(
                "port P1 tcp client 127.0.0.1:{server} in-flight 16\n\
                 port P502 tcp server 127.0.0.1:{port} clients 64\nroute P502 * * * P1\n"
            ),
            (Self::Mbusd | Self::MbusdShortPause, Behind::Line { device, pace, timeout_ms }) => {
                let pause = if self == Self::MbusdShortPause { "pause = 1\n" } else { "" };
                format!(
                    "device = {device}\nspeed = {}\nmode = 8n2\naddress = 127.0.0.1\nport = {port}\nmaxconn = 64\n\
                     retries = 0\nwait = {timeout_ms}\n{pause}",
                    pace.baud
                )
            }
            (Self::ModbusRelay, Behind::Line { device, pace, timeout_ms }) => format!(
                "tcp:\n  bind_addr: 127.0.0.1\n  bind_port: {port}\n  keep_alive: 60s\n\
                 rtu:\n  device: {device}\n  baud_rate: {}\n  data_bits: 8\n  parity: none\n  stop_bits: two\n  \
                 flush_after_write: true\n  rts_type: none\n  rts_delay_us: 0\n  transaction_timeout: {timeout_ms}ms\n  \
                 serial_timeout: {timeout_ms}ms\n  max_frame_size: 256\nhttp:\n  enabled: false\n  \
                 bind_addr: 127.0.0.1\n  bind_port: 0\n  metrics_enabled: false\nlogging:\n  log_dir: {folder}\n  \
                 level: error\n  trace_frames: false\n  format: json\n  include_location: false\n  \
                 thread_ids: false\n  thread_names: false\nconnection:\n  max_connections: 100\n  per_ip_limits: 100\n  \
                 idle_timeout: 60s\n  error_timeout: 300s\n  connect_timeout: 5s\n  backoff:\n    \
                 initial_interval: 100ms\n    max_interval: 30s\n    multiplier: 2.0\n    max_retries: 5\n",
                pace.baud
            ),
            (Self::ModbusGateway, behind) => {
                let downstream = match behind {
                    Behind::Line { device, pace, timeout_ms } => format!(
                        "type = \"serial\"\nport = \"{device}\"\nmode = \"rtu\"\nbaud_rate = {}\nstop_bits = 2\n\
                         response_timeout_ms = {timeout_ms}\n",
                        pace.baud
                    ),
                    Behind::Tcp(server) => format!("type = \"tcp\"\naddress = \"127.0.0.1:{server}\"\n"),
                };
                // It takes ranges of units, and does not use them.
                let route =
                    |unit| format!("[[route]]\ntype = \"unit\"\nunit_id = {unit}\ndownstream = \"devices\"\n");
                let routes: String = (1..=64).map(route).collect();
                format!(
                    "[general]\nlog_level = \"error\"\ntui = false\n[[upstream]]\ntype = \"tcp\"\n\
                     bind = \"127.0.0.1:{port}\"\n[[downstream]]\nname = \"devices\"\n{downstream}\
                     {routes}"
                )
            }
            (Self::ModbusProxyRs, Behind::Tcp(server)) => format!(
                "devices:\n- modbus:\n    url: 127.0.0.1:{server}\n  listen:\n    bind: 127.0.0.1:{port}\n"
            ),
            // By its arguments alone; the others are not asked to do what they cannot.
            _ => String::new(),
        }
    }
}

fn proxy_arguments(behind: Behind<'_>, port: u16) -> [String; 4] {
    let server = match behind {
        Behind::Tcp(server) => server,
        Behind::Line { .. } => 0,
    };
    ["-b".into(), format!("127.0.0.1:{port}"), "--modbus".into(), format!("tcp://127.0.0.1:{server}")]
}
