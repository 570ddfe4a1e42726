//! The board's lines, which ports open by name.

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::{Mutex, MutexGuard};
use embassy_time::{Duration, Instant};
use embedded_io_async::{ErrorKind, ErrorType, Read, Write};
use mobgate::hal::{Flaws, OpenError, OpenErrorKind, Relay, SerialHost, SerialLine};
use mobgate::settings::LineSettings;

use crate::line::Line;

/// RS-485 lines of an STM32 board.
pub(crate) const LINES: usize = 4;

/// A line, locked by the port that uses it.
pub(crate) type SharedLine = Mutex<NoopRawMutex, Line>;

/// The board's lines, `uart1` to `uart4`.
#[derive(Clone, Copy)]
pub(crate) struct Lines(pub(crate) &'static [SharedLine; LINES]);

/// An open line.
pub(crate) struct OpenLine(MutexGuard<'static, NoopRawMutex, Line>);

impl SerialHost for Lines {
    type Line<'a> = OpenLine;

    async fn open(&mut self, device: &str, settings: &LineSettings) -> Result<OpenLine, OpenError> {
        let hint = "this board's lines are uart1 to uart4";
        let line = number(device).and_then(|number| self.0.get(number));
        let line = line.ok_or(OpenError::new(OpenErrorKind::NotFound, hint))?;
        let mut open = line
            .try_lock()
            .map_err(|_| OpenError::new(OpenErrorKind::InUse, "by another port of the gateway"))?;
        open.configure(settings)?;
        Ok(OpenLine(open))
    }

    /// DMA and interrupts feed the transmitter, and a character takes far longer than any task's poll. Only an F7 that saves its
    /// settings stalls: it breaks off the frame that is being passed on, as it cannot respond in time anyway.
    fn never_underruns(&self) -> bool {
        true
    }
}

/// The number of line `device`.
fn number(device: &str) -> Option<usize> {
    match device.as_bytes() {
        [b'u', b'a', b'r', b't', digit @ b'1'..=b'9'] => Some(usize::from(digit - b'1')),
        _ => None,
    }
}

impl Drop for OpenLine {
    fn drop(&mut self) {
        self.end_relay();
        self.hold_driver(false);
    }
}

impl SerialLine for OpenLine {
    const RESTS: bool = Line::RESTS;

    async fn rest(&mut self, until: Instant) -> bool {
        self.0.rest(until).await
    }

    fn take_flaws(&mut self) -> Flaws {
        self.0.take_flaws()
    }

    fn hold_driver(&mut self, on: bool) {
        self.0.hold_driver(on);
    }

    fn relay(&mut self, from: &str, relay: Relay) -> bool {
        number(from).is_some_and(|from| self.0.relay(from, relay))
    }

    fn end_relay(&mut self) -> Option<Relay> {
        self.0.end_relay()
    }

    fn is_relayed(&self) -> bool {
        self.0.is_relayed()
    }

    fn silence(&self) -> Duration {
        self.0.silence()
    }
}

impl ErrorType for OpenLine {
    type Error = ErrorKind;
}

impl Read for OpenLine {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, ErrorKind> {
        self.0.read(into).await
    }
}

impl Write for OpenLine {
    async fn write(&mut self, from: &[u8]) -> Result<usize, ErrorKind> {
        self.0.write(from).await
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        self.0.flush().await
    }
}
