//! Stub of the demo: only real serial lines, and settings must come from a file.

use clap::Args;
use embassy_executor::Spawner;
use mobgate::settings::Settings;

use crate::cli::Options;
use crate::start::Start;
use crate::tcp::TcpSockets;
pub use crate::tty::TtyHost as Lines;

pub(crate) const EXAMPLES: &str = "";

/// The demo's options: none.
#[derive(Debug, Args)]
pub struct Choice {}

impl Choice {
    pub(crate) fn has_settings(&self) -> bool {
        false
    }
}

/// Always an error: there are no settings without a file.
pub(crate) fn check(_: &Options) -> Result<(), String> {
    Err("no settings: name their file with --config FILE (this program was built without the demo)"
        .to_owned())
}

/// Always an error, see [`check`].
pub(crate) fn start(options: &Options, _: &TcpSockets) -> Result<Start, String> {
    check(options).map(|()| Start { settings: Settings::new(), listeners: Vec::new() })
}

/// Starts nothing; returns the host of the serial lines.
pub fn spawn(_: &Options, _: Spawner) -> Lines {
    Lines
}
