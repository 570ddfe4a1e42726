//! The gateways that are measured, and how each is told what stands behind it.
//!
//! `MOBGATE_PEERS` names the folder into which `cargo xtask peers` has installed what the package registries have, `MBUSD` an
//! mbusd. Every one listens on the loopback address only, and gets the same line settings and time-out as mobgate; pauses and
//! the like stay as they come, but for mbusd, which runs a second time with the shortest pause that it takes.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use strum::{EnumIter, IntoStaticStr};

use crate::common::mobgate;
use crate::line::Pace;

mod settings;

/// A gateway.
#[derive(Clone, Copy, PartialEq, Eq, EnumIter, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub(crate) enum Contestant {
    Mobgate,
    Mbusd,
    #[strum(serialize = "mbusd, 1 ms pause")]
    MbusdShortPause,
    ModbusRelay,
    ModbusGateway,
    ModbusProxy,
    ModbusProxyRs,
}

/// What stands behind a gateway.
#[derive(Clone, Copy)]
pub(crate) enum Behind<'a> {
    /// A serial line.
    Line(Wired<'a>),
    /// A server on this machine.
    Tcp(u16),
}

/// A serial line behind a gateway.
#[derive(Clone, Copy)]
pub(crate) struct Wired<'a> {
    pub(crate) device: &'a str,
    pub(crate) pace: Pace,
    /// How long its units may take to respond.
    pub(crate) timeout_ms: u32,
}

impl Contestant {
    pub(crate) fn name(self) -> &'static str {
        self.into()
    }

    /// Whether it can have that behind it at all.
    pub(crate) fn takes(self, behind: Behind<'_>) -> bool {
        match behind {
            Behind::Line(_) => !matches!(self, Self::ModbusProxy | Self::ModbusProxyRs),
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
            Self::Mobgate => command.arg("--config").arg(settings).args(["--socket", "off"]),
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
            Self::ModbusRelay | Self::ModbusGateway | Self::ModbusProxyRs => {
                path.join("bin").join(self.name())
            }
        };
        if path.exists() { Ok(path) } else { Err(format!("{} is not there", path.display())) }
    }

    fn settings(self, behind: Behind<'_>, folder: &Path, port: u16) -> String {
        match (self, behind) {
            (Self::Mobgate, behind) => settings::mobgate(behind, port),
            (Self::Mbusd, Behind::Line(line)) => settings::mbusd(line, port),
            (Self::MbusdShortPause, Behind::Line(line)) => settings::mbusd(line, port) + "pause = 1\n",
            (Self::ModbusRelay, Behind::Line(line)) => settings::modbus_relay(line, port, folder),
            (Self::ModbusGateway, behind) => settings::modbus_gateway(behind, port),
            (Self::ModbusProxyRs, Behind::Tcp(server)) => settings::modbus_proxy_rs(server, port),
            // By its arguments alone; the others are not asked to do what they cannot.
            _ => String::new(),
        }
    }
}

fn proxy_arguments(behind: Behind<'_>, port: u16) -> [String; 4] {
    let server = match behind {
        Behind::Tcp(server) => server,
        Behind::Line(_) => 0,
    };
    ["-b".into(), format!("127.0.0.1:{port}"), "--modbus".into(), format!("tcp://127.0.0.1:{server}")]
}
