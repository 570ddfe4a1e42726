//! The serial lines that the program knows: ttys by their file names and, in the demo, the simulated bus.

use std::fs;
use std::io;
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::PathBuf;

use embassy_time::{Duration, Instant};
use embedded_io_async::{Error, ErrorKind, ErrorType, Read, Write};
use mobgate::hal::{Flaws, OpenError, SerialHost, SerialLine};
use mobgate::settings::LineSettings;
use mobgate_simulator::SimSerial;
use mobgate_simulator::serial::SimLine;

use crate::demo;
use crate::file;
use crate::tty::{self, Tty, TtyHost};

/// The 16 ms for which an FTDI adapter may hold characters back, and the scheduler's delay.
const READ_JITTER: Duration = Duration::from_millis(20);

/// Opens ttys, and the demo's bus when there is one.
#[derive(Clone, Default)]
pub struct Lines {
    demo: Option<SimSerial>,
}

impl Lines {
    /// The system's ttys and `demo`'s bus besides.
    pub fn with_demo(demo: SimSerial) -> Self {
        Self { demo: Some(demo) }
    }
}

impl SerialHost for Lines {
    type Line<'a> = Line;

    async fn open(&mut self, device: &str, line: &LineSettings) -> Result<Line, OpenError> {
        match &mut self.demo {
            Some(demo) if device == demo::DEVICE => demo.open(device, line).await.map(Line::Demo),
            _ => TtyHost.open(device, line).await.map(Line::Tty),
        }
    }

    fn read_jitter(&self) -> Duration {
        READ_JITTER
    }
}

/// Whether two names are one line's: they lead to one device, or will when it is plugged in.
pub fn are_same(one: &str, other: &str) -> bool {
    one == other || identity(one) == identity(other)
}

/// The number of a character device, or else the path at which it is missed.
fn identity(device: &str) -> Result<u64, PathBuf> {
    let path = tty::path(device);
    let number = fs::metadata(&path).ok().filter(|facts| facts.file_type().is_char_device());
    number.map(|facts| facts.rdev()).ok_or_else(|| file::resolve(&path))
}

/// An open line.
pub enum Line {
    /// A real one.
    Tty(Tty),
    /// The demo's.
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
