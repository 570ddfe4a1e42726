//! The board's lines, which ports open by name.

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::{Mutex, MutexGuard};
use embedded_io_async::{ErrorKind, ErrorType, Read, Write};
use mobgate::hal::{Flaws, OpenError, OpenErrorKind, SerialHost, SerialLine};
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
        let number = device.strip_prefix("uart").and_then(|number| number.parse::<usize>().ok());
        let line = number.and_then(|number| self.0.get(number.checked_sub(1)?));
        let line = line.ok_or(OpenError::new(OpenErrorKind::NotFound, hint))?;
        let mut open = line
            .try_lock()
            .map_err(|_| OpenError::new(OpenErrorKind::InUse, "by another port of the gateway"))?;
        open.configure(settings)?;
        Ok(OpenLine(open))
    }

    /// DMA feeds the transmitter, and a character takes far longer than any task's poll. But an F7 stalls while its flash is
    /// erased, which would tear a frame that is being forwarded.
    fn never_underruns(&self) -> bool {
        !cfg!(feature = "f7")
    }
}

impl SerialLine for OpenLine {
    fn take_flaws(&mut self) -> Flaws {
        self.0.take_flaws()
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
