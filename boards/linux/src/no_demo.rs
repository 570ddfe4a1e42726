//! Stub of the demo: only real serial lines, and settings must come from a file.

use std::path::Path;
use std::rc::Rc;

use clap::Args;
use embassy_executor::Spawner;
use mobgate::settings::{Settings, TcpListen};

use crate::tcp::{Listener, TcpSockets};
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
pub(crate) fn check(_: &Choice, _: Option<&Path>) -> Result<(), String> {
    Err("no settings: name their file with --config FILE (this program was built without the demo)"
        .to_owned())
}

/// Always an error, see [`check`].
pub(crate) fn start(
    demo: &Choice,
    _: Option<TcpListen>,
    _: &TcpSockets,
) -> Result<(Settings, Vec<Rc<Listener>>), String> {
    check(demo, None).map(|()| (Settings::new(), Vec::new()))
}

/// Starts nothing; returns the host of the serial lines.
pub fn spawn(_: &Choice, _: Option<&Path>, _: Spawner) -> Lines {
    Lines
}
