//! The console's interface to the board.

use core::fmt::Write;

use heapless::String;
use mobgate::hal::{NetworkState, System};
use mobgate_board::last_words::WORDS_BYTES_MAX;

use crate::sockets::Network;
use crate::start::Problem;

/// A board and the events of its start.
pub struct Board {
    name: &'static str,
    network: Network,
    cause: &'static str,
    last_words: Option<String<WORDS_BYTES_MAX>>,
    pub(crate) settings: Option<Problem>,
    reboot: fn() -> !,
}

impl Board {
    /// Board `name`, started for this `cause`, and how to start it again.
    pub fn new(name: &'static str, network: Network, cause: &'static str, reboot: fn() -> !) -> Self {
        Self { name, network, cause, last_words: mobgate_faults::take(), settings: None, reboot }
    }
}

impl System for Board {
    fn name(&self) -> &str {
        self.name
    }

    fn network(&self) -> Option<NetworkState> {
        Some(mobgate_net::address::state(self.network.stack()))
    }

    fn write_event(&self, n: usize, out: &mut dyn Write) -> Option<core::fmt::Result> {
        let last_words =
            self.last_words.as_ref().map(|words| ("the last run ended: ", words as &dyn core::fmt::Display));
        let settings =
            self.settings.as_ref().map(|problem| ("settings: ", problem as &dyn core::fmt::Display));
        let cause = Some(("board: ", &self.cause as &dyn core::fmt::Display));
        let (what, text) = [cause, last_words, settings].into_iter().flatten().nth(n)?;
        Some(write!(out, "{what}{text}"))
    }

    fn reboot(&self) {
        (self.reboot)()
    }
}
