//! Serial lines of a simulated board: device names, each an end of a wire.

use embedded_io_async::{ErrorKind, ErrorType, Read, Write};
use mobgate::config::LineSettings;
use mobgate::hal::{OpenError, OpenErrorKind, SerialHost, SerialLine};

use crate::wire::LineEnd;

/// Opens wire ends by device name. Clones know the same devices.
#[derive(Clone, Default)]
pub struct SimSerial {
    devices: Vec<(String, LineEnd)>,
}

impl SimSerial {
    /// A board without serial lines.
    pub fn new() -> Self {
        Self::default()
    }

    /// The board with `end` as its device `name`; opening sets the end's speed and format.
    #[must_use]
    pub fn with(mut self, name: &str, end: &LineEnd) -> Self {
        self.devices.push((name.to_owned(), end.clone()));
        self
    }
}

impl SerialHost for SimSerial {
    type Line<'a> = SimLine;

    async fn open(&mut self, device: &str, line: &LineSettings) -> Result<SimLine, OpenError> {
        let error = |kind| OpenError::new(kind, "");
        let (_, end) =
            self.devices.iter().find(|(name, _)| name == device).ok_or(error(OpenErrorKind::NotFound))?;
        end.open(*line).map(SimLine).map_err(|kind| match kind {
            ErrorKind::AddrInUse => error(OpenErrorKind::InUse),
            _ => error(OpenErrorKind::NotFound),
        })
    }
}

/// An open serial line; dropping it closes it.
pub struct SimLine(LineEnd);

impl Drop for SimLine {
    fn drop(&mut self) {
        self.0.close();
    }
}

impl SerialLine for SimLine {
    async fn drive(&mut self, on: bool) -> Result<(), ErrorKind> {
        self.0.drive(on);
        Ok(())
    }
}

impl ErrorType for SimLine {
    type Error = ErrorKind;
}

impl Read for SimLine {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, ErrorKind> {
        self.0.read(into).await
    }
}

impl Write for SimLine {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, ErrorKind> {
        self.0.write(bytes).await
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        self.0.flush().await
    }
}
