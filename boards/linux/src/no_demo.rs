//! What stands for the demo where the program has none: real lines, and a file of settings that must be named.

use clap::Args;
use embassy_executor::Spawner;

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
pub(crate) fn start(_: &Options, _: &TcpSockets) -> Result<Start, String> {
    Err("no settings: name their file with --config FILE (this program was built without the demo)"
        .to_owned())
}

/// Nothing has to be started: gives what ports open serial lines by.
pub fn spawn(_: &Options, _: Spawner) -> Lines {
    Lines
}
