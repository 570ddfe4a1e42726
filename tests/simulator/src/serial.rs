//! Serial lines of a simulated board: device names, each an end of a wire.

use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{ErrorKind, ErrorType, Read, Write};
use mobgate::hal::Relay;
use mobgate::hal::{Flaws, OpenError, OpenErrorKind, SerialHost, SerialLine};
use mobgate::settings::LineSettings;

use crate::wire::LineEnd;

/// Opens wire ends by device name. Clones know the same devices.
#[derive(Clone, Default)]
pub struct SimSerial {
    pub(crate) devices: Vec<(String, LineEnd)>,
    /// There is an operating system or an adapter in between: what is heard is read at multiples of this time only.
    pub(crate) late_reads: Duration,
    /// It sleeps while characters gather of which it needs none alone, and so may read this late. Without such a time it never
    /// sleeps.
    pub(crate) rests: Duration,
    /// Its interrupts count characters, and wake it when those that it needs together are there.
    pub(crate) gathers: bool,
    /// So long it takes to open a line.
    pub(crate) opening: Duration,
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
        if self.opening > Duration::default() {
            Timer::after(self.opening).await;
        }
        let found = self.devices.iter().find(|(name, _)| name == device);
        let (_, end) = found.ok_or(error(OpenErrorKind::NotFound))?;
        let board = self.clone();
        end.open(*line).map(|end| SimLine { end, board, source: None, needed: 1 }).map_err(
            |kind| match kind {
                ErrorKind::AddrInUse => error(OpenErrorKind::InUse),
                _ => error(OpenErrorKind::NotFound),
            },
        )
    }

    fn read_jitter(&self) -> Duration {
        self.late_reads.max(self.rests)
    }

    fn never_underruns(&self) -> bool {
        self.read_jitter() == Duration::default()
    }
}

/// An open serial line; dropping it closes it.
pub struct SimLine {
    end: LineEnd,
    board: SimSerial,
    /// Whose characters are sent here.
    source: Option<LineEnd>,
    /// So many characters are read together.
    needed: usize,
}

impl Drop for SimLine {
    fn drop(&mut self) {
        self.end_relay();
        self.end.close();
    }
}

impl SerialLine for SimLine {
    const RESTS: bool = true;

    async fn drive(&mut self, on: bool) -> Result<(), ErrorKind> {
        self.end.drive(on);
        Ok(())
    }

    fn relay(&mut self, from: &str, relay: Relay) -> bool {
        let source = self.board.devices.iter().find(|(name, _)| name == from);
        self.source = source.map(|(_, end)| end.clone());
        self.source.iter().for_each(|source| source.begin_relay(relay, &self.end));
        self.source.is_some()
    }

    fn end_relay(&mut self) -> Option<Relay> {
        self.source.take()?.end_relay()
    }

    fn is_relayed(&self) -> bool {
        self.end.is_relayed()
    }

    fn silence(&self) -> Duration {
        self.end.silence()
    }

    async fn rest(&mut self, until: Instant) -> bool {
        let sleeps = self.board.rests > Duration::default() && until > Instant::now();
        if sleeps {
            Timer::at(until).await;
        }
        sleeps
    }

    fn gather(&mut self, characters: usize) -> bool {
        self.needed = if self.board.gathers { characters } else { 1 };
        self.board.gathers
    }

    fn take_flaws(&mut self) -> Flaws {
        self.end.take_flaws()
    }
}

impl ErrorType for SimLine {
    type Error = ErrorKind;
}

impl Read for SimLine {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, ErrorKind> {
        let late = self.board.late_reads;
        if late > Duration::default() {
            self.end.readable(1).await;
            let now = Instant::now().as_ticks();
            Timer::at(Instant::from_ticks(now.next_multiple_of(late.as_ticks()))).await;
        }
        if self.needed > 1 {
            self.end.readable(self.needed).await;
            self.needed = 1;
        }
        self.end.read(into).await
    }
}

impl Write for SimLine {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, ErrorKind> {
        self.end.write(bytes).await
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        self.end.flush().await
    }
}
