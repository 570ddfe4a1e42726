//! `mobgate console`: joins the console of a gateway running on this machine.
//!
//! At a terminal the gateway's line editor gets each key and draws the output, so the terminal is raw until the end, even if a
//! signal ends the program. Otherwise lines are sent, from the command line or standard input, and only the responses are printed.

use std::io::{self, IsTerminal, Read as _, Write as _, stdin, stdout};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level::emulate_default_handler;

use super::hello::{Hello, carried_out};
use super::socket;
use crate::cli::Join;
use crate::stdio::{TerminalMode, hand_on};

/// Exit code: a line was refused.
const REFUSED: u8 = 1;
/// Exit code: no gateway was reached, or it ended the session.
const NOT_ASKED: u8 = 3;

/// Joins the console until the session ends, or runs one line.
pub fn run(join: &Join) -> ExitCode {
    exit_code(converse(join))
}

/// Tells how lines ended: see [`converse`].
pub(super) fn exit_code(ended: Result<Option<bool>, String>) -> ExitCode {
    match ended {
        Ok(Some(true)) => ExitCode::SUCCESS,
        Ok(Some(false)) => ExitCode::from(REFUSED),
        Ok(None) => ExitCode::from(NOT_ASKED),
        Err(fault) => {
            eprintln!("mobgate: {fault}");
            ExitCode::from(NOT_ASKED)
        }
    }
}

/// Whether the gateway carried out all lines; `None` if it did not tell.
fn converse(join: &Join) -> Result<Option<bool>, String> {
    if !join.line.is_empty() {
        return carry_out(join.socket.as_deref(), &(join.line.join(" ") + "\n"));
    }
    let stream = socket::connect(join.socket.as_deref())?;
    let terminal = stdin().is_terminal() && stdout().is_terminal();
    let _raw_until_the_end =
        if terminal { Some(Terminal::enter(TerminalMode::raw).map_err(fault)?) } else { None };
    greet(&stream, if terminal { Hello::Terminal } else { Hello::Lines });
    let to = stream.try_clone().map_err(fault)?;
    // A separate thread, because the gateway may stop reading until its responses are read.
    thread::spawn(move || {
        hand_on(stdin(), &to, terminal);
        // If the session ended first, there is no peer.
        to.shutdown(Shutdown::Write)
    });
    // At a terminal the user has seen the result of each line.
    print(&stream).map(|all| if terminal { all.map(|_| true) } else { all }).map_err(fault)
}

/// Runs `lines` in a session of their own, and prints their output. Whether the gateway carried out all; `None` if it did not tell.
pub(super) fn carry_out(socket: Option<&Path>, lines: &str) -> Result<Option<bool>, String> {
    let stream = socket::connect(socket)?;
    greet(&stream, Hello::Lines);
    hand_on(lines.as_bytes(), &stream, stdout().is_terminal());
    let _ = stream.shutdown(Shutdown::Write);
    print(&stream).map_err(fault)
}

fn fault(error: io::Error) -> String {
    format!("console: {error}")
}

/// Starts the session. Write errors are ignored: if the gateway has closed the connection, it has sent the reason.
fn greet(mut stream: &UnixStream, hello: Hello) {
    if let Some(byte) = hello.byte() {
        let _ = stream.write_all(&[byte]);
    }
}

/// The terminal's mode, which ends on drop, or before a signal ends the program.
pub(super) struct Terminal(Arc<Mutex<Option<TerminalMode>>>);

impl Terminal {
    /// Changes the mode by `enter`.
    pub(super) fn enter(enter: fn() -> Option<TerminalMode>) -> io::Result<Self> {
        let mut signals = Signals::new([SIGHUP, SIGINT, SIGQUIT, SIGTERM])?;
        let changed = Self(Arc::new(Mutex::new(enter())));
        let shared = Self(changed.0.clone());
        thread::spawn(move || {
            for signal in signals.forever() {
                shared.leave();
                let _ = emulate_default_handler(signal);
            }
        });
        Ok(changed)
    }

    /// Whether the mode was changed.
    pub(super) fn has_changed(&self) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }

    fn leave(&self) {
        drop(self.0.lock().unwrap_or_else(PoisonError::into_inner).take());
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        self.leave();
    }
}

/// Prints the session's output until its end; returns the status in its last byte.
fn print(mut stream: &UnixStream) -> io::Result<Option<bool>> {
    let (mut piece, mut last) = ([0; 4096], None);
    loop {
        let part = match stream.read(&mut piece) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Ok(count @ 1..) => &piece[..count],
            // The gateway closed or dropped the connection.
            _ => return Ok(last),
        };
        last = part.last().copied().and_then(carried_out);
        let text = &part[..part.len() - usize::from(last.is_some())];
        stdout().write_all(text)?;
        stdout().flush()?;
    }
}
