//! The console on standard input and output.
//!
//! Threads read and write: epoll does not support files, and a non-blocking terminal would be so for all processes that have it
//! open, the shell included. At a terminal the console edits and echoes by itself, so the terminal is in raw mode until [`TerminalMode`]
//! is dropped.

use std::io::{self, stdin};
use std::os::unix::net::UnixStream;
use std::thread;

use embedded_io_async::{ErrorType, Read, Write};
use rustix::process::getpgrp;
use rustix::termios::{
    InputModes, LocalModes, OptionalActions, SpecialCodeIndex, Termios, isatty, tcgetattr, tcgetpgrp,
    tcsetattr,
};

use crate::descriptor::Descriptor;
use crate::screen::{self, Screen};
use crate::sink::Sink;

/// Standard input and output as one stream.
#[derive(Debug)]
pub struct Stdio {
    /// Bytes read by a thread.
    input: Descriptor<UnixStream>,
    output: Sink<Screen>,
    ended: bool,
}

impl Stdio {
    /// Opens the standard streams. Fails if the program is in a terminal's background: reading would stop it.
    pub fn open() -> io::Result<Self> {
        if isatty(stdin()) && tcgetpgrp(stdin()).is_ok_and(|foreground| foreground != getpgrp()) {
            return Err(io::Error::other("in the background of a terminal"));
        }
        let is_terminal = screen::is_shared();
        let (ours, theirs) = UnixStream::pair()?;
        thread::Builder::new().name("stdin".into()).spawn(move || hand_on(stdin(), theirs, is_terminal))?;
        Ok(Self { input: Descriptor::new(ours)?, output: Sink::new(Screen)?, ended: false })
    }

    /// Whether a read has reached the end of input.
    pub fn has_ended(&self) -> bool {
        self.ended
    }
}

impl ErrorType for Stdio {
    type Error = io::Error;
}

impl Read for Stdio {
    async fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let read = self.input.read_stream(into).await;
        self.ended = !matches!(read, Ok(1..));
        read
    }
}

impl Write for Stdio {
    async fn write(&mut self, from: &[u8]) -> io::Result<usize> {
        self.output.write(from).await
    }

    async fn flush(&mut self) -> io::Result<()> {
        self.output.flush().await
    }
}

/// Forwards input until either side ends. A console at a terminal is sent the terminal's size at the start and, if it has changed,
/// when Enter is pressed.
pub(crate) fn hand_on(mut from: impl io::Read, mut to: impl io::Write, terminal: bool) {
    let report = || screen::size_report().filter(|_| terminal).unwrap_or_default();
    let mut piece = [0; 4096];
    let mut told = report();
    if to.write_all(told.as_bytes()).is_err() {
        return;
    }
    loop {
        let typed = match from.read(&mut piece) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Ok(count @ 1..) => &piece[..count],
            _ => return,
        };
        let size = if typed.contains(&b'\r') { report() } else { told.clone() };
        let news = if size == told { "" } else { &size };
        if to.write_all(&[news.as_bytes(), typed].concat()).is_err() {
            return;
        }
        told = size;
    }
}

/// Keeps the terminal in another mode; restores the old one on drop, even during a panic.
#[derive(Debug)]
pub struct TerminalMode(Termios);

impl TerminalMode {
    /// Puts standard input into raw mode, if it is a terminal in whose foreground this program runs.
    ///
    /// Ctrl-C becomes a key of the console. Ctrl-Z is disabled, because it would leave the shell with a raw terminal. Ctrl-\ stays
    /// a signal, in case the program hangs. Output keeps its line-end translation for log lines.
    pub fn raw() -> Option<Self> {
        Self::change(|raw| {
            raw.local_modes -= LocalModes::ICANON | LocalModes::ECHO | LocalModes::IEXTEN;
            raw.input_modes -= InputModes::ICRNL | InputModes::INLCR | InputModes::IXON;
            raw.special_codes[SpecialCodeIndex::VINTR] = 0;
            raw.special_codes[SpecialCodeIndex::VSUSP] = 0;
            raw.special_codes[SpecialCodeIndex::VMIN] = 1;
            raw.special_codes[SpecialCodeIndex::VTIME] = 0;
        })
    }

    /// Hides what is typed, under the same condition. Lines and signals stay as they are.
    pub fn hidden() -> Option<Self> {
        Self::change(|hidden| hidden.local_modes -= LocalModes::ECHO)
    }

    fn change(by: impl FnOnce(&mut Termios)) -> Option<Self> {
        let old = tcgetattr(stdin()).ok()?;
        if tcgetpgrp(stdin()).ok()? != getpgrp() {
            return None; // in the background: changing the terminal would stop the program
        }
        let mut new = old.clone();
        by(&mut new);
        tcsetattr(stdin(), OptionalActions::Now, &new).ok()?;
        Some(Self(old))
    }
}

impl Drop for TerminalMode {
    fn drop(&mut self) {
        let _ = tcsetattr(stdin(), OptionalActions::Now, &self.0);
    }
}
