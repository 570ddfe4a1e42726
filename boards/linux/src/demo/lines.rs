//! The serial lines of a program with the demo: ttys by file name, and the simulated bus.

use std::io;

use embassy_time::{Duration, Instant};
use embedded_io_async::{Error, ErrorKind, ErrorType, Read, Write};
use mobgate::hal::{Flaws, OpenError, SerialHost, SerialLine};
use mobgate::settings::LineSettings;
use mobgate_simulator::SimSerial;
use mobgate_simulator::serial::SimLine;

use super::DEVICE;
use crate::tty::{Tty, TtyHost};

/// Opens ttys, and the demo's bus if it runs.
#[derive(Clone, Default)]
pub struct Lines {
    pub(super) demo: Option<SimSerial>,
}

impl SerialHost for Lines {
    type Line<'a> = Line;

    async fn open(&mut self, device: &str, line: &LineSettings) -> Result<Line, OpenError> {
        match &mut self.demo {
            Some(demo) if device == DEVICE => demo.open(device, line).await.map(Line::Demo),
            _ => TtyHost.open(device, line).await.map(Line::Tty),
        }
    }

    fn read_jitter(&self) -> Duration {
        TtyHost.read_jitter()
    }
}

/// An open line.
pub enum Line {
    /// A tty.
    Tty(Tty),
    /// The demo's bus.
    Demo(SimLine),
}

impl SerialLine for Line {
    const RESTS: bool = true;

    async fn drive(&mut self, on: bool) -> Result<(), ErrorKind> {
        match self {
            Self::Tty(line) => line.drive(on).await.map_err(kind),
            Self::Demo(line) => line.drive(on).await,
        }
    }

    async fn rest(&mut self, until: Instant) -> bool {
        match self {
            Self::Tty(line) => line.rest(until).await,
            Self::Demo(line) => line.rest(until).await,
        }
    }

    fn take_flaws(&mut self) -> Flaws {
        match self {
            Self::Tty(line) => line.take_flaws(),
            Self::Demo(line) => line.take_flaws(),
        }
    }
}

impl ErrorType for Line {
    type Error = ErrorKind;
}

impl Read for Line {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, ErrorKind> {
        match self {
            Self::Tty(line) => line.read(into).await.map_err(kind),
            Self::Demo(line) => line.read(into).await,
        }
    }
}

impl Write for Line {
    async fn write(&mut self, from: &[u8]) -> Result<usize, ErrorKind> {
        match self {
            Self::Tty(line) => line.write(from).await.map_err(kind),
            Self::Demo(line) => line.write(from).await,
        }
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        match self {
            Self::Tty(line) => line.flush().await.map_err(kind),
            Self::Demo(line) => line.flush().await,
        }
    }
}

fn kind(error: io::Error) -> ErrorKind {
    Error::kind(&error)
}
