//! The console's sessions: on standard input and output, on a Unix socket, on an optional TCP port, and by SSH.
//!
//! A connection to the socket, the port or an SSH server is a [`Guest`], which gets one of the [`Sessions`].

use std::fmt::Display;
use std::rc::Rc;

use embassy_time::{Duration, Timer};
use mobgate::console::{self, Ended, Mode};
use mobgate::gateway::Gateway;
use mobgate::hal::{NoUpdate, OpenError, System, TcpHost};
use mobgate::settings::TcpListen;
use rustix::termios::isatty;

use crate::cli::ConsolePort;
use crate::ssh;
use crate::stdio::Stdio;
use crate::store::FileStore;
use crate::tcp::{Listener, TcpSockets};

pub mod client;
mod guest;
mod hello;
mod peer;
mod sessions;
pub mod socket;
pub mod user;

pub use guest::Guest;
pub(crate) use hello::carried_out;
pub use sessions::{SESSIONS_MAX, Sessions};

/// Pause after a failed accept.
const ACCEPT_PAUSE: Duration = Duration::from_secs(1);

/// Updates of a program are not its own.
pub fn by_package() -> NoUpdate {
    NoUpdate("the package manager brings new versions: apt install ./mobgate_*.deb")
}

/// Serves standard input as a terminal or as lines of text until its end. Then (`/dev/null`, a service) the console ends and the
/// gateway continues. Returns true if the user wants the program to end.
pub async fn on_stdio(gateway: &Gateway<'_>, mut store: FileStore, system: &impl System) -> bool {
    let mut stdio = match Stdio::open() {
        Ok(stdio) => stdio,
        Err(error) => {
            log::info!("no console on standard input: {error}");
            return false;
        }
    };
    let mode = if isatty(std::io::stdin()) { Mode::Foreground } else { Mode::Plain };
    loop {
        match console::run(gateway, &mut stdio, &mut store, &mut by_package(), system, mode).await {
            Ok(Ended::Stopped) => return true,
            Ok(_) if mode == Mode::Foreground && !stdio.has_ended() => {}
            _ => return false,
        }
        // The user typed `exit`, but there is no shell to return to, and the terminal stays raw.
        log::info!("the gateway goes on; Ctrl-C, on an empty line and once more, stops it");
    }
}

/// Accepts connections to the TCP port at `listen`; never returns.
pub async fn on_tcp(sessions: &Sessions, mut sockets: TcpSockets, listen: TcpListen) {
    admit(sessions, &format!("TCP port {listen}"), async || {
        let (stream, peer) = sockets.accept(&listen).await?;
        Ok::<_, OpenError>(Guest::by_tcp(stream, peer))
    })
    .await
}

/// Accepts authorised connections to the socket; never returns.
pub async fn on_socket(gateway: &Gateway<'_>, sessions: &Sessions, mut listener: socket::Listener) {
    let name = listener.to_string();
    admit(sessions, &name, async || listener.accept(gateway).await).await
}

/// Accepts users authenticated by SSH; never returns.
pub async fn by_ssh(sessions: &Sessions) {
    admit(sessions, "SSH", async || Guest::by_ssh(ssh::next_entrant().await)).await
}

/// Admits every guest from `next`; `place` names the listener in the log.
async fn admit<E: Display>(
    sessions: &Sessions,
    place: &str,
    mut next: impl AsyncFnMut() -> Result<Guest, E>,
) {
    loop {
        match next().await {
            Ok(guest) => sessions.admit(guest),
            Err(error) => {
                log::warn!("console on {place}: {error}");
                Timer::after(ACCEPT_PAUSE).await;
            }
        }
    }
}

/// Opens the console's TCP port, if there is one.
pub fn open_tcp(
    wanted: Option<ConsolePort>,
    sockets: &TcpSockets,
) -> Result<Option<(TcpListen, Rc<Listener>)>, String> {
    let Some(ConsolePort(Some(listen))) = wanted else { return Ok(None) };
    let listener = sockets.open(&listen).map_err(|error| format!("console on TCP port {listen}: {error}"))?;
    Ok(Some((listen, listener)))
}
