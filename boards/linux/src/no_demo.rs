//! What stands for the demo where the program has none: real lines, and a file of settings that must be named.

use clap::Args;
use embassy_executor::Spawner;
use mobgate::settings::Settings;

use crate::cli::Options;
use crate::start::Start;
use crate::tcp::TcpSockets;
pub use crate::tty::TtyHost as Lines;

pub(crate) const EXAMPLES: &str = "";

/// There is nothing to choose.
#[derive(Debug, Args)]
pub struct Choice {}

impl Choice {
    pub(crate) fn has_settings(&self) -> bool {
        false
    }
}

/// There are no settings without a file.
pub(crate) fn check(_: &Options) -> Result<(), String> {
    Err("no settings: name their file with --config FILE (this program was built without the demo)"
        .to_owned())
}

/// Nothing starts.
pub(crate) fn start(options: &Options, _: &TcpSockets) -> Result<Start, String> {
    check(options).map(|()| Start { settings: Settings::new(), listeners: Vec::new() })
}

/// Nothing has to be started: gives what ports open serial lines by.
pub fn spawn(_: &Options, _: Spawner) -> Lines {
    Lines
}
