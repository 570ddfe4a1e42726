//! The console's interface to the board.

use core::cell::RefCell;
use core::fmt::Write;

use heapless::String;
use mobgate::hal::{FirmwareState, NetworkState, System};
use mobgate_board::last_words::WORDS_BYTES_MAX;
#[cfg(feature = "users")] // Images without them are smaller, see Cargo.toml.
use mobgate_passwords::Passwords;
use mobgate_update::Reason;

use crate::gateway::gateway;
use crate::lines;
use crate::sockets::Network;
use crate::start::Problem;

/// Fills bytes with random numbers that nobody can guess; returns whether it can.
#[cfg(feature = "users")]
pub type Random = fn(&mut [u8]) -> bool;

#[cfg(feature = "users")]
static PASSWORDS: static_cell::ConstStaticCell<Passwords> =
    static_cell::ConstStaticCell::new(Passwords::new());

/// A board and the events of its start.
pub struct Board {
    name: &'static str,
    pub(crate) network: Network,
    cause: &'static str,
    last_words: Option<String<WORDS_BYTES_MAX>>,
    pub(crate) settings: Option<Problem>,
    firmware: RefCell<Option<FirmwareState>>,
    reboot: fn() -> !,
    #[cfg(feature = "users")]
    passwords: (&'static Passwords, Random),
}

impl Board {
    /// Board `name`, started for this `cause`, and how to start it again. Before any task runs: the audit trail begins here.
    pub fn new(name: &'static str, network: Network, cause: &'static str, reboot: fn() -> !) -> Self {
        let (last_words, firmware) = (mobgate_faults::take(), RefCell::new(None));
        gateway().audit_start(cause, last_words.as_deref());
        Self {
            name,
            network,
            cause,
            last_words,
            settings: None,
            firmware,
            reboot,
            #[cfg(feature = "users")]
            passwords: (PASSWORDS.take(), |_| false),
        }
    }

    /// Takes the chip's random numbers, without which no password can be set.
    #[cfg(feature = "users")]
    pub fn set_random(&mut self, random: Random) {
        self.passwords.1 = random;
    }

    /// Why the board was started, as a reason to go back.
    pub(crate) fn why(&self) -> Reason {
        let mut why = Reason::new();
        // What is too long is cut off.
        let _ = match &self.last_words {
            Some(words) => why.write_str(words),
            None => write!(why, "{} while on trial", self.cause),
        };
        why
    }

    /// How what runs came to run.
    pub(crate) fn set_firmware(&self, state: FirmwareState) {
        self.firmware.replace(Some(state));
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

    fn write_serial_line(&self, n: usize, out: &mut dyn Write) -> Option<core::fmt::Result> {
        lines::write_name(n, out)
    }

    fn firmware(&self) -> Option<FirmwareState> {
        self.firmware.borrow().clone()
    }

    #[cfg(feature = "users")]
    async fn is_password(&self, hash: Option<&str>, password: &str) -> bool {
        self.passwords.0.is_right(hash, password)
    }

    #[cfg(feature = "users")]
    async fn hash_password(&self, password: &str) -> Option<mobgate::settings::PasswordHash> {
        let (passwords, random) = self.passwords;
        passwords.hash(password, random)
    }

    #[cfg(feature = "users")]
    fn random(&self, into: &mut [u8]) -> bool {
        (self.passwords.1)(into)
    }

    fn reboot(&self) {
        (self.reboot)()
    }
}
