//! The command line.

use std::convert::Infallible;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Args, CommandFactory, Parser, Subcommand};
use mobgate::settings::TcpListen;

use crate::demo;

/// Address of a console port given without one.
const THIS_MACHINE: IpAddr = IpAddr::V4(Ipv4Addr::LOCALHOST);

const EXAMPLES: &str = "  mobgate --config mobgate.conf        run a gateway with these settings
  mobgate --check mobgate.conf         check them
  mobgate console                      join the running gateway's console
  mobgate console show ports           run one line there
  mobgate user add anna                let anna log in by network
  mobgate esi mobgate.xml              describe the SubDevice for EtherCAT
                                       tools; `sii FILE`: for its EEPROM

A configuration file:
  port P1    serial /dev/ttyUSB0 rtu client 19200 8E1
  port P5502 tcp server 5502
  route P5502 1-247 * * P1

In the program's own terminal Ctrl-C ends a command, then clears the line,
and twice on an empty line stops the gateway. SIGHUP reads the file again,
SIGTERM and SIGINT end the program. RUST_LOG sets what is logged (info, ...).

Exit codes: 0 ended by a signal, or the checked file is good;
1 bad configuration, or a port cannot be opened; 2 bad command line.";

/// A Modbus gateway: clients on TCP, devices on serial lines, and rules between.
// The demo is optional.
#[cfg_attr(feature = "demo", doc = "\nWithout options the demo runs.")]
#[derive(Debug, Parser)]
#[command(
    name = "mobgate",
    next_line_help = true,
    version,
    after_help = format!("Examples:\n{}{EXAMPLES}", demo::EXAMPLES),
    args_conflicts_with_subcommands = true
)]
pub struct Options {
    /// What to do instead of running the gateway
    #[command(subcommand)]
    pub instead: Option<Instead>,

    /// Read the settings from FILE, and let `save` write them there
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,

    /// The demo's options, if it is built in
    #[command(flatten)]
    pub demo: demo::Choice,

    /// Override where the first TCP server listens
    #[arg(long, value_name = "[ADDR:]PORT", value_parser = listen)]
    pub listen: Option<TcpListen>,

    /// Check the settings in FILE and exit
    #[arg(long, value_name = "FILE", conflicts_with_all = ["config", "listen", "console", "socket", "capture"])]
    pub check: Option<PathBuf>,

    /// Write the frames of all ports into FILE (PCAPNG), for Wireshark;
    /// the console's `capture` does so while it runs
    #[arg(long, verbatim_doc_comment, value_name = "FILE")]
    pub capture: Option<PathBuf>,

    /// Offer the console on a socket at PATH, for root, this user and the
    /// group mobgate [default: /run/mobgate/console, or else
    /// $XDG_RUNTIME_DIR/mobgate/console, or else mobgate-UID/console in
    /// the folder for temporary files]
    #[arg(long, verbatim_doc_comment, value_name = "PATH|off")]
    pub socket: Option<SocketPlace>,

    /// Also offer the console on a TCP port of this machine, to users who
    /// log in [default: off]
    #[arg(long, verbatim_doc_comment, value_name = "[ADDR:]PORT|off")]
    pub console: Option<ConsolePort>,
}

/// What to do instead of running the gateway.
#[derive(Debug, Subcommand)]
pub enum Instead {
    /// Join the console of the running gateway, or run LINE there
    ///
    /// Ctrl-D leaves. Lines may also come from a pipe. Exit codes: 0 all
    /// lines succeeded; 1 a line failed; 2 bad command line; 3 no gateway
    /// was reached, or it closed the session.
    #[command(verbatim_doc_comment)]
    Console(Join),
    /// Change who may log in to the running gateway
    #[command(subcommand)]
    User(User),
    /// Write a file about the gateway as an EtherCAT SubDevice
    #[command(flatten)]
    Make(Make),
}

/// The console to join, and the line to run.
#[derive(Debug, Args)]
pub struct Join {
    /// The gateway's socket, if it is not at one of the default paths
    #[arg(long, value_name = "PATH")]
    pub socket: Option<PathBuf>,

    /// Line to run; put it in quotes if it contains quotes
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    pub line: Vec<String>,
}

/// What to change of a user.
#[derive(Debug, Subcommand)]
pub enum User {
    /// Add a user, or give a user another role and password, and save
    ///
    /// The password is asked for twice, or read from standard input if
    /// that is no terminal. Who may use the gateway's console may do so.
    /// Exit codes as of `mobgate console`.
    #[command(verbatim_doc_comment)]
    Add(NewUser),
}

/// The user to add.
#[derive(Debug, Args)]
pub struct NewUser {
    /// Name of the user: a letter, then letters, digits, - _ or .
    pub name: String,

    /// What the user may do
    #[arg(long, default_value = "engineer", value_parser = ["viewer", "operator", "engineer"])]
    pub role: String,

    /// The gateway's socket, if it is not at one of the default paths
    #[arg(long, value_name = "PATH")]
    pub socket: Option<PathBuf>,
}

/// The description files of the EtherCAT SubDevice.
#[derive(Debug, Subcommand)]
pub enum Make {
    /// Write the EEPROM image of the EtherCAT controller (SII) to FILE
    Sii {
        /// For the modular device: `port NAME ethercat modules`
        #[arg(long)]
        modules: bool,
        /// Output file
        file: PathBuf,
    },
    /// Write the description for EtherCAT tools (ESI) to FILE
    Esi {
        /// Also describe slaves and EoE of the settings in FILE
        #[arg(long, value_name = "FILE")]
        config: Option<PathBuf>,
        /// Output file
        file: PathBuf,
    },
}

impl Options {
    /// Parses the command line; exits with an error if it is invalid.
    pub fn of_command_line() -> Self {
        Self::try_parse().unwrap_or_else(|error| Self::lead_on(error).exit())
    }

    /// Explains how to pass a settings file if one was given in place of a command.
    fn lead_on(error: clap::Error) -> clap::Error {
        match error.get(ContextKind::InvalidSubcommand) {
            Some(ContextValue::String(word)) if word.contains(['.', '/']) || Path::new(word).exists() => {
                let what = format!("a settings file needs its option: mobgate --config {word}");
                Self::command().error(ErrorKind::InvalidSubcommand, what)
            }
            _ => error,
        }
    }
}

/// The path of the console's socket, if there is one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SocketPlace {
    /// No socket.
    Off,
    /// At this path.
    At(PathBuf),
}

impl FromStr for SocketPlace {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(if text == "off" { Self::Off } else { Self::At(text.into()) })
    }
}

/// TCP address of the console, if it has one. A bare port number means this machine only.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ConsolePort(pub Option<TcpListen>);

impl FromStr for ConsolePort {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "off" {
            return Ok(Self(None));
        }
        let TcpListen { address, port } = listen(text)?;
        let address = address.unwrap_or(THIS_MACHINE);
        // Passwords that are typed there can be read by whoever carries them.
        if !address.is_loopback() {
            return Err(format!("it is not encrypted: on this machine only, such as {THIS_MACHINE}:{port}"));
        }
        Ok(Self(Some(TcpListen { address: Some(address), port })))
    }
}

/// Parses `5020`, `127.0.0.1:5020` or `[::1]:5020`.
fn listen(text: &str) -> Result<TcpListen, String> {
    let parsed = match text.parse::<u16>() {
        Ok(port) => TcpListen { address: None, port },
        Err(_) => {
            let both: SocketAddr =
                text.parse().map_err(|_| "expected PORT, ADDRESS:PORT or [ADDRESS]:PORT".to_owned())?;
            TcpListen { address: Some(both.ip()), port: both.port() }
        }
    };
    if parsed.port == 0 { Err("port must be 1-65535".to_owned()) } else { Ok(parsed) }
}

#[cfg(test)]
mod tests {
    use clap::{CommandFactory, Parser};

    use super::{ConsolePort, Options, TcpListen, listen};

    #[test]
    fn the_options_fit_together() {
        Options::command().debug_assert();
    }

    #[test]
    fn help_fits_into_eighty_columns() {
        let mut command = Options::command();
        command.build();
        let short_and_long =
            |command: &mut clap::Command| format!("{}{}", command.render_help(), command.render_long_help());
        let own = short_and_long(&mut command);
        let all = command.get_subcommands_mut().map(short_and_long).fold(own, |all, one| all + &one);
        let long: Vec<_> = all.lines().filter(|line| line.chars().count() > 80).collect();
        assert!(long.is_empty(), "{long:#?}");
    }

    #[test]
    fn a_file_where_a_command_belongs_leads_to_the_option() {
        for file in ["mobgate.conf", "/etc/x", "."] {
            let said = Options::lead_on(Options::try_parse_from(["mobgate", file]).unwrap_err()).to_string();
            assert!(said.contains(&format!("mobgate --config {file}")), "{said}");
        }
        let said = Options::lead_on(Options::try_parse_from(["mobgate", "start"]).unwrap_err()).to_string();
        assert!(!said.contains("--config"), "{said}");
    }

    #[test]
    fn a_listening_place_is_a_port_with_or_without_an_address() {
        assert_eq!(listen("5020"), Ok(TcpListen { address: None, port: 5020 }));
        let ipv6 = TcpListen { address: Some("::1".parse().unwrap()), port: 502 };
        assert_eq!(listen("[::1]:502"), Ok(ipv6));
        for bad in ["", "0", "65536", "localhost", "1.2.3.4", "1.2.3.4:0", ":5020"] {
            assert!(listen(bad).is_err(), "{bad:?} was taken");
        }
    }

    #[test]
    fn the_console_stays_on_this_machine_unless_an_address_is_given() {
        let ConsolePort(bare) = "5026".parse().unwrap();
        assert!(bare.unwrap().address.unwrap().is_loopback());
        assert_eq!("off".parse(), Ok(ConsolePort(None)));
    }
}
