//! The console on standard input and output.
//!
//! Threads do the reading and writing: epoll refuses files, and making a terminal non-blocking would do so to everything
//! else that has it open, the shell included. On a terminal the console edits and echoes by itself, so the
//! terminal is put into raw mode until [`RawMode`] is dropped.

use std::io::{self, Read as _, stdin};
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
    /// What a thread has read.
    input: Descriptor<UnixStream>,
    output: Sink<Screen>,
    ended: bool,
}

impl Stdio {
    /// The program's standard streams; an error when it runs in the background of a terminal: reading would stop it.
    pub fn open() -> io::Result<Self> {
        if isatty(stdin()) && tcgetpgrp(stdin()).is_ok_and(|foreground| foreground != getpgrp()) {
            return Err(io::Error::other("in the background of a terminal"));
        }
        let is_terminal = screen::is_shared();
        let (ours, theirs) = UnixStream::pair()?;
        thread::Builder::new().name("stdin".into()).spawn(move || hand_on(stdin(), theirs, is_terminal))?;
        Ok(Self { input: Descriptor::new(ours)?, output: Sink::new(Screen)?, ended: false })
    }

    /// Whether a read has met the end of input.
    pub fn has_ended(&self) -> bool {
        self.ended
    }
}

impl ErrorType for Stdio {
    type Error = io::Error;
}

impl Read for Stdio {
    async fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let read = self.input.read_stream(into, |mut input, into| input.read(into)).await;
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

/// Hands on what is typed until one of the two ends. A console at a terminal is told how wide that is, at first and whenever Enter is
/// pressed.
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

/// Holds the terminal in raw mode; dropping it, also by a panic, brings the old mode back.
#[derive(Debug)]
pub struct RawMode(Termios);

impl RawMode {
    /// Puts standard input into raw mode when it is a terminal that this program may change.
    ///
    /// Ctrl-C becomes a key of the console, and Ctrl-Z none, because the shell would be left with a raw terminal; Ctrl-\ stays a
    /// signal, for a program that does not react. Output keeps its line endings for log lines.
    pub fn enter() -> Option<Self> {
        let old = tcgetattr(stdin()).ok()?;
        if tcgetpgrp(stdin()).ok()? != getpgrp() {
            return None; // in the background: changing the terminal would stop the program
        }
        let mut raw = old.clone();
        raw.local_modes -= LocalModes::ICANON | LocalModes::ECHO | LocalModes::IEXTEN;
        raw.input_modes -= InputModes::ICRNL | InputModes::INLCR | InputModes::IXON;
        raw.special_codes[SpecialCodeIndex::VINTR] = 0;
        raw.special_codes[SpecialCodeIndex::VSUSP] = 0;
        raw.special_codes[SpecialCodeIndex::VMIN] = 1;
        raw.special_codes[SpecialCodeIndex::VTIME] = 0;
        tcsetattr(stdin(), OptionalActions::Now, &raw).ok()?;
        Some(Self(old))
    }
}

impl Drop for RawMode {
    fn drop(&mut self) {
        let _ = tcsetattr(stdin(), OptionalActions::Now, &self.0);
    }
}
