//! Serial lines: a Linux tty in raw mode, opened exclusively, read and written through epoll.
//!
//! Opening communicates with the device (a USB adapter takes some milliseconds), so a worker thread does it. Reading and writing
//! never block: the port's task sleeps in the executor until the descriptor is ready.

use std::fs::File;
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread;

use embassy_time::{Duration, Instant};
use embedded_io_async::{ErrorType, Read, Write};
use mobgate::hal::{Flaws, OpenError, OpenErrorKind, SerialHost, SerialLine};
use mobgate::settings::{Driver, LineSettings, Parity};
use rustix::fs::{FlockOperation, flock, fstat, major};
use rustix::io::Errno;
use rustix::termios::{QueueSelector, ioctl_tiocexcl, ioctl_tiocnxcl, tcflush};
use serial2::rs4xx::{Rs485Config, TransceiverMode};
use serial2::{CharSize, SerialPort, StopBits};

use crate::descriptor::Descriptor;
use crate::worker::{self, Worker};
use crate::{file, hint};

mod low_latency;
pub mod names;
mod receiver;

use receiver::Receiver;

/// Major device numbers of the slave side of Unix98 PTYs, which have no physical line and no parity.
const PTY_MAJORS: std::ops::RangeInclusive<u32> = 136..=143;

/// An FTDI adapter may hold characters back for 16 ms; the rest is scheduling delay.
const READ_JITTER: Duration = Duration::from_millis(20);

/// Attempts at a line that is in use, and the pause behind each: together half a second.
const BUSY_ATTEMPTS: u32 = 10;
const BUSY_PAUSE: std::time::Duration = std::time::Duration::from_millis(50);

/// Opens `/dev/...` names, symbolic links such as those in `/dev/serial/by-id`, and bare names (`ttyUSB0`).
#[derive(Debug, Clone, Default)]
pub struct TtyHost;

/// An open serial line.
#[derive(Debug)]
pub struct Tty {
    io: Descriptor<File>,
    receiver: Receiver,
    /// Set if RTS switches the transceiver's driver.
    rts: Option<Rts>,
}

/// A second handle of the line to switch its RTS, and a worker that waits until its characters have left.
#[derive(Debug)]
struct Rts {
    port: Arc<SerialPort>,
    worker: Worker,
}

impl Rts {
    fn new(port: &SerialPort) -> io::Result<Self> {
        Ok(Self { port: Arc::new(port.try_clone()?), worker: Worker::start()? })
    }
}

impl SerialHost for TtyHost {
    type Line<'a> = Tty;

    async fn open(&mut self, device: &str, line: &LineSettings) -> Result<Tty, OpenError> {
        let (device, line) = (path(device), *line);
        let failed = |_| OpenError::new(OpenErrorKind::Failed, "");
        let port = worker::once(move || open_once_free(&device, &line)).await.map_err(failed)??;
        let rts = match line.driver {
            Driver::Rts => Some(Rts::new(&port).map_err(failed)?),
            Driver::Automatic | Driver::Rs485 => None,
        };
        let io = Descriptor::new(File::from(OwnedFd::from(port)))
            .map_err(|_| OpenError::new(OpenErrorKind::Unsupported, "not a serial device"))?;
        // Only now: an opening that was given up would leave a PTY in this mode.
        ioctl_tiocexcl(&io).map_err(|error| failed(error.into()))?;
        Ok(Tty { receiver: Receiver::new(&io), io, rts })
    }

    fn read_jitter(&self) -> Duration {
        READ_JITTER
    }
}

/// The path of `device`.
fn path(device: &str) -> PathBuf {
    // Joining an absolute path replaces the folder.
    Path::new("/dev").join(device)
}

/// Whether two names mean the same line: they lead to one device, or will when it is plugged in.
pub fn are_same(one: &str, other: &str) -> bool {
    one == other || identity(one) == identity(other)
}

/// The number of a character device, or the resolved path if there is none.
fn identity(device: &str) -> Result<u64, PathBuf> {
    let path = path(device);
    let number = std::fs::metadata(&path).ok().filter(|facts| facts.file_type().is_char_device());
    number.map(|facts| facts.rdev()).ok_or_else(|| file::resolve(&path))
}

/// Opens the line, if need be after some attempts: an opening that the port has given up, since its settings have changed again, holds
/// the line until its thread is done.
fn open_once_free(device: &Path, line: &LineSettings) -> Result<SerialPort, OpenError> {
    for _ in 0..BUSY_ATTEMPTS {
        match open(device, line) {
            Err(error) if error.kind == OpenErrorKind::InUse => thread::sleep(BUSY_PAUSE),
            opened => return opened,
        }
    }
    open(device, line)
}

fn open(device: &Path, line: &LineSettings) -> Result<SerialPort, OpenError> {
    let mut port = SerialPort::open(device, |settings: serial2::Settings| Ok(settings))
        .map_err(|error| refusal(&error, device))?;
    // The lock stops programs that use locks, even root's, to whom TIOCEXCL does not apply.
    flock(&port, FlockOperation::NonBlockingLockExclusive).map_err(|error| refusal(&error.into(), device))?;
    configure(&mut port, line)
        .map_err(|_| OpenError::new(OpenErrorKind::Unsupported, "speed or character format"))?;
    prepare_driver(&mut port, line)?;
    low_latency::request(&port, device);
    // Characters received before belong to no request.
    let _ = tcflush(&port, QueueSelector::IFlush);
    Ok(port)
}

/// Leaves the transceiver's driver to the kernel, or switches it off until the first transmission.
fn prepare_driver(port: &mut SerialPort, line: &LineSettings) -> Result<(), OpenError> {
    let refused = |hint| OpenError::new(OpenErrorKind::Unsupported, hint);
    match line.driver {
        Driver::Automatic => Ok(()),
        Driver::Rs485 => {
            // The kernel counts milliseconds: round up.
            let delay = |time: Duration| std::time::Duration::from_millis(time.as_micros().div_ceil(1_000));
            let mut config = Rs485Config::new();
            config.set_delay_before_send(delay(line.driver_before));
            config.set_delay_after_send(delay(line.driver_after));
            port.set_rs4xx_mode(TransceiverMode::Rs485(config))
                .map_err(|_| refused("the driver has no rs485 mode; try rts instead of rs485"))
        }
        Driver::Rts => port.set_rts(false).map_err(|_| refused("the line has no RTS; remove the word rts")),
    }
}

fn configure(port: &mut SerialPort, line: &LineSettings) -> io::Result<()> {
    let mut settings = port.get_configuration()?;
    settings.set_raw();
    settings.set_baud_rate(line.baud)?;
    settings.set_stop_bits(if line.stop_bits == 2 { StopBits::Two } else { StopBits::One });
    port.set_configuration(&settings)?;

    settings.set_char_size(if line.data_bits == 7 { CharSize::Bits7 } else { CharSize::Bits8 });
    settings.set_parity(match line.parity {
        Parity::None => serial2::Parity::None,
        Parity::Even => serial2::Parity::Even,
        Parity::Odd => serial2::Parity::Odd,
    });
    match port.set_configuration(&settings) {
        Err(_) if is_pty(port) => Ok(()),
        set => set,
    }
}

fn is_pty(port: &impl AsFd) -> bool {
    fstat(port).is_ok_and(|facts| PTY_MAJORS.contains(&major(facts.st_rdev)))
}

/// Maps a system error to the user's.
fn refusal(error: &io::Error, device: &Path) -> OpenError {
    let (kind, hint) = match Errno::from_io_error(error) {
        Some(Errno::NOENT | Errno::NODEV | Errno::NXIO | Errno::IO) => (OpenErrorKind::NotFound, ""),
        Some(Errno::ACCESS | Errno::PERM) => (OpenErrorKind::Denied, hint::device_denied(device)),
        Some(Errno::BUSY | Errno::WOULDBLOCK) => (OpenErrorKind::InUse, ""),
        Some(Errno::NOTTY | Errno::ISDIR) => (OpenErrorKind::Unsupported, "not a serial device"),
        _ => (OpenErrorKind::Failed, ""),
    };
    OpenError::new(kind, hint)
}

impl SerialLine for Tty {
    const RESTS: bool = true;

    async fn drive(&mut self, on: bool) -> io::Result<()> {
        let Some(Rts { port, worker }) = &self.rts else { return Ok(()) };
        if on {
            return port.set_rts(true);
        }
        // Adapters buffer characters. Waiting for them blocks, so a worker does it.
        let port = port.clone();
        let off = move || {
            port.flush()?;
            port.set_rts(false)
        };
        worker.run(off).await
    }

    async fn rest(&mut self, until: Instant) -> bool {
        self.io.rest(until).await
    }

    fn take_flaws(&mut self) -> Flaws {
        self.receiver.take_flaws(&self.io)
    }
}

impl ErrorType for Tty {
    type Error = io::Error;
}

impl Read for Tty {
    fn read(&mut self, into: &mut [u8]) -> impl Future<Output = io::Result<usize>> {
        self.io.read_stream(into)
    }
}

impl Write for Tty {
    fn write(&mut self, from: &[u8]) -> impl Future<Output = io::Result<usize>> {
        self.io.write_stream(from)
    }

    /// Nothing is buffered here. Waiting until the characters have left (tcdrain) would block all other tasks.
    async fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for Tty {
    fn drop(&mut self) {
        // Closing a tty waits for its output, up to 30 s if a device holds it back.
        let _ = tcflush(&self.io, QueueSelector::IOFlush);
        // The exclusive mode of a PTY outlives this descriptor while its other side is open.
        let _ = ioctl_tiocnxcl(&self.io);
    }
}
