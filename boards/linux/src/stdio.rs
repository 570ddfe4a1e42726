//! The console on standard input and output.
//!
//! Worker threads do the reading and writing: epoll refuses files, and making a terminal non-blocking would do so to
//! everything else that has it open, the shell included. On a terminal the console edits and echoes by itself, so the
//! terminal is put into raw mode until [`RawMode`] is dropped.

use std::io::{self, Stdin, Stdout, stdin, stdout};

use blocking::Unblock;
use embedded_io_async::{ErrorType, Read, Write};
use futures_lite::{AsyncReadExt, AsyncWriteExt};
use rustix::process::getpgrp;
use rustix::termios::{
    InputModes, LocalModes, OptionalActions, SpecialCodeIndex, Termios, isatty, tcgetattr, tcgetpgrp,
    tcsetattr,
};

/// Standard input and output as one stream.
#[derive(Debug)]
pub struct Stdio {
    input: Unblock<Stdin>,
    output: Unblock<Stdout>,
    ended: bool,
}

impl Stdio {
    /// The program's standard streams, or none when it runs in the background of a terminal: reading would stop it.
    pub fn open() -> Option<Self> {
        let background =
            isatty(stdin()) && tcgetpgrp(stdin()).is_ok_and(|foreground| foreground != getpgrp());
        (!background).then(|| Self {
            input: Unblock::new(stdin()),
            output: Unblock::new(stdout()),
            ended: false,
        })
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
        let read = self.input.read(into).await;
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

/// Holds the terminal in raw mode; dropping it, also by a panic, brings the old mode back.
#[derive(Debug)]
pub struct RawMode(Termios);

impl RawMode {
    /// Puts standard input into raw mode when it is a terminal that this program may change.
    ///
    /// Keys that make signals stay (Ctrl-C ends the program), all but the one that suspends it, because the shell
    /// would be left with a raw terminal. Output keeps its line endings for log lines.
    pub fn enter() -> Option<Self> {
        let old = tcgetattr(stdin()).ok()?;
        if tcgetpgrp(stdin()).ok()? != getpgrp() {
            return None; // in the background: changing the terminal would stop the program
        }
        let mut raw = old.clone();
        raw.local_modes -= LocalModes::ICANON | LocalModes::ECHO | LocalModes::IEXTEN;
        raw.input_modes -= InputModes::ICRNL | InputModes::INLCR | InputModes::IXON;
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
