//! The board's lines, which ports open by name.

use core::fmt;

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::{Mutex, MutexGuard};
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{ErrorType, Read, Write};
use mobgate::hal::{Flaws, OpenError, OpenErrorKind, Relay, SerialHost, SerialLine};
use mobgate::settings::LineSettings;

/// RS-485 lines of a board.
pub const LINES: usize = 4;

/// A line of a chip. Its [`SerialLine::relay`] is not used: here lines have numbers.
pub trait Line: SerialLine {
    /// [`SerialHost::never_underruns`].
    const NEVER_UNDERRUNS: bool;

    /// Sets speed, character format and driver times, and discards earlier input.
    fn configure(&mut self, line: &LineSettings) -> Result<(), OpenError>;

    /// [`SerialLine::relay`] of what line `from` receives, counted from 0.
    fn relay_from(&mut self, _from: usize, _relay: Relay) -> bool {
        false
    }
}

/// [`SerialLine::rest`]: `set` lets characters accumulate without waking the port, and ends that, also when this is dropped.
pub async fn rest(until: Instant, set: impl Fn(bool)) -> bool {
    struct Rest<S: Fn(bool)>(S);
    impl<S: Fn(bool)> Drop for Rest<S> {
        fn drop(&mut self) {
            self.0(false);
        }
    }
    let rests = until > Instant::now();
    if rests {
        set(true);
        let _rest = Rest(set);
        Timer::at(until).await;
    }
    rests
}

/// A line, locked by the port that uses it.
pub type SharedLine<L> = Mutex<NoopRawMutex, L>;

/// The board's lines, `uart1` to `uart4`.
pub struct Lines<L: 'static>(pub &'static [SharedLine<L>; LINES]);

impl<L> Clone for Lines<L> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<L> Copy for Lines<L> {}

/// An open line.
pub struct OpenLine<L: Line + 'static>(MutexGuard<'static, NoopRawMutex, L>);

impl<L: Line> SerialHost for Lines<L> {
    type Line<'a> = OpenLine<L>;

    async fn open(&mut self, device: &str, settings: &LineSettings) -> Result<OpenLine<L>, OpenError> {
        let hint = "this board's lines are uart1 to uart4";
        let line = number(device).and_then(|number| self.0.get(number));
        let line = line.ok_or(OpenError::new(OpenErrorKind::NotFound, hint))?;
        let mut open = line
            .try_lock()
            .map_err(|_| OpenError::new(OpenErrorKind::InUse, "by another port of the gateway"))?;
        open.configure(settings)?;
        Ok(OpenLine(open))
    }

    fn never_underruns(&self) -> bool {
        L::NEVER_UNDERRUNS
    }
}

/// Writes the name of line `number`, from 0; `None` after the last one.
pub(crate) fn write_name(number: usize, out: &mut dyn fmt::Write) -> Option<fmt::Result> {
    (number < LINES).then(|| write!(out, "uart{}", number + 1))
}

/// The number of line `device`, from 0.
fn number(device: &str) -> Option<usize> {
    match device.as_bytes() {
        [b'u', b'a', b'r', b't', digit @ b'1'..=b'9'] => Some(usize::from(digit - b'1')),
        _ => None,
    }
}

impl<L: Line> Drop for OpenLine<L> {
    fn drop(&mut self) {
        self.end_relay();
        self.hold_driver(false);
    }
}

impl<L: Line> SerialLine for OpenLine<L> {
    const RESTS: bool = L::RESTS;

    fn rest(&mut self, until: Instant) -> impl Future<Output = bool> {
        self.0.rest(until)
    }

    fn gather(&mut self, characters: usize) -> bool {
        self.0.gather(characters)
    }

    fn take_flaws(&mut self) -> Flaws {
        self.0.take_flaws()
    }

    fn hold_driver(&mut self, on: bool) {
        self.0.hold_driver(on);
    }

    fn relay(&mut self, from: &str, relay: Relay) -> bool {
        number(from).is_some_and(|from| self.0.relay_from(from, relay))
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

impl<L: Line> ErrorType for OpenLine<L> {
    type Error = L::Error;
}

impl<L: Line> Read for OpenLine<L> {
    fn read(&mut self, into: &mut [u8]) -> impl Future<Output = Result<usize, L::Error>> {
        self.0.read(into)
    }
}

impl<L: Line> Write for OpenLine<L> {
    fn write(&mut self, from: &[u8]) -> impl Future<Output = Result<usize, L::Error>> {
        self.0.write(from)
    }

    fn flush(&mut self) -> impl Future<Output = Result<(), L::Error>> {
        self.0.flush()
    }
}
