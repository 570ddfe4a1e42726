//! The console's sessions: on standard input and output, and on a TCP port.

use std::net::IpAddr;
use std::rc::Rc;

use embassy_time::{Duration, Timer};
use mobgate::config::TcpListen;
use mobgate::console::{self, Mode};
use mobgate::gateway::Gateway;
use mobgate::hal::{System, TcpHost, TcpStream};
use rustix::termios::isatty;

use crate::cli::{CONSOLE_DEFAULT, ConsolePort};
use crate::stdio::Stdio;
use crate::store::FileStore;
use crate::tcp::{Listener, TcpSockets};

/// Pause after a connection could not be accepted.
const ACCEPT_PAUSE: Duration = Duration::from_secs(1);

/// Serves standard input until its end, as a terminal or as lines of text. At the end of the input (`/dev/null`, a
/// service) the console ends and the gateway goes on.
pub async fn on_stdio(gateway: &Gateway<'_>, mut store: FileStore, system: &impl System) {
    let Some(mut stdio) = Stdio::open() else {
        log::info!("in the background of a terminal: no console on standard input");
        return;
    };
    let mode = if isatty(std::io::stdin()) { Mode::Echo } else { Mode::Plain };
    loop {
        let ended = console::run(gateway, &mut stdio, &mut store, system, mode).await;
        if stdio.has_ended() || ended.is_err() || mode == Mode::Plain {
            return;
        }
        // The user typed `exit`. There is nowhere to go to, and the terminal stays raw.
        log::info!("the gateway goes on; Ctrl-C ends it");
    }
}

/// Serves one TCP session after the other at `listen`, for ever. Several of these share the listener.
///
/// What `nc` and scripts send are lines, so they are neither echoed nor prompted for.
pub async fn on_tcp(
    gateway: &Gateway<'_>,
    mut sockets: TcpSockets,
    listen: TcpListen,
    store: FileStore,
    system: &impl System,
) {
    loop {
        match sockets.accept(&listen).await {
            Ok((mut stream, peer)) => {
                log::info!("console session of {peer}");
                let ended = console::run(gateway, &mut stream, &mut store.clone(), system, Mode::Plain).await;
                log::debug!("console session of {peer} has ended: {ended:?}");
                stream.close().await;
            }
            Err(error) => {
                log::warn!("console on TCP port {listen}: {error}");
                Timer::after(ACCEPT_PAUSE).await;
            }
        }
    }
}

/// Opens the console's TCP port, if one is wanted: the default one may be taken by another mobgate, one that the user
/// named must be free.
pub fn open(
    wanted: Option<ConsolePort>,
    sockets: &TcpSockets,
) -> Result<Option<(TcpListen, Rc<Listener>)>, String> {
    let Some(listen) = wanted.map_or(Some(CONSOLE_DEFAULT), |ConsolePort(listen)| listen) else {
        return Ok(None);
    };
    match sockets.open(&listen) {
        Ok(listener) => {
            if !listen.address.is_some_and(|address: IpAddr| address.is_loopback()) {
                log::warn!("the console at {listen} can be reached from other machines, without a password");
            }
            Ok(Some((listen, listener)))
        }
        Err(error) if wanted.is_none() => {
            log::warn!("no console on TCP port {listen}: {error}");
            Ok(None)
        }
        Err(error) => Err(format!("console on TCP port {listen}: {error}")),
    }
}
