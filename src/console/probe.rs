//! What `scan` and `tune` have in common: a serial client's line, a harmless request, when an answer began, and whether the
//! console still watches.

use core::fmt;
use core::future::pending;
use core::pin::pin;

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant};
use embedded_io_async::{Read, Write};
use heapless::Vec;

use super::command::Session;
use crate::config::{
    Framing, LineSettings, PortId, PortKind, Problem, SerialSettings, Settings, Side, Word, Wrong,
};
use crate::hal::{Store, System};
use crate::modbus::pdu::function::{DIAGNOSTICS, REPORT_SERVER_ID};

/// How often the console is told at least how far a long command is: that somebody has gone is found out by it.
const PROGRESS: Duration = Duration::from_secs(5);
/// Bytes of the longest request.
const REQUEST_BYTES_MAX: usize = 5;

/// The port that `word` names, which must be a serial client.
pub(super) fn serial_client<'s>(
    settings: &'s Settings,
    word: Word<'_>,
) -> Result<(PortId, &'s SerialSettings), Wrong> {
    let port = settings.find(word.text).ok_or_else(|| word.error(Problem::NoSuchPort))?;
    match settings.port(port).map(|port| &port.kind) {
        Some(PortKind::Serial(serial)) if serial.side == Side::Client => Ok((port, serial)),
        _ => Err(word.expected("a port that is the client of a serial line")),
    }
}

/// A request of `function` that changes nothing: one cell, the first one, or what is given back (8), or who the unit is (17).
pub(super) fn request(function: u8) -> Vec<u8, REQUEST_BYTES_MAX> {
    let request: &[u8] = match function {
        DIAGNOSTICS => &[DIAGNOSTICS, 0, 0, 0xa5, 0x37],
        REPORT_SERVER_ID => &[REPORT_SERVER_ID],
        function => &[function, 0, 0, 0, 1],
    };
    Vec::from_slice(request).unwrap_or_default()
}

/// The time to the first character of an answer with `pdu_bytes` that took so long to its end: what a time-out is for.
pub(super) fn to_first_char(
    took: Duration,
    framing: Framing,
    line: &LineSettings,
    pdu_bytes: usize,
) -> Duration {
    let behind = line.chars(framing.chars_of(pdu_bytes) - 1);
    took.checked_sub(behind).unwrap_or(Duration::from_ticks(0))
}

/// Whether the console is still there, and when it was told something last.
pub(super) struct Watch {
    told: Instant,
    /// Its input has ended: it cannot stop anything any more, but it may read.
    ended: bool,
}

impl Watch {
    pub(super) fn new() -> Self {
        Self { told: Instant::now(), ended: false }
    }

    /// Whether it is time to tell how far a command is.
    pub(super) fn is_due(&mut self) -> bool {
        let due = self.told.elapsed() >= PROGRESS;
        if due {
            self.told = Instant::now();
        }
        due
    }
}

impl<IO: Read + Write, S: Store, Y: System> Session<'_, '_, IO, S, Y> {
    /// What comes of `work`; `None` when something is typed first.
    pub(super) async fn unless_typed<T>(
        &mut self,
        watch: &mut Watch,
        work: impl Future<Output = T>,
    ) -> Result<Option<T>, IO::Error> {
        let mut work = pin!(work);
        loop {
            let mut typed = [0; 16];
            let read = async { if watch.ended { pending().await } else { self.out.read(&mut typed).await } };
            match select(read, work.as_mut()).await {
                Either::First(Ok(0)) => watch.ended = true,
                Either::First(Ok(_)) => return Ok(None),
                Either::First(Err(error)) => return Err(error),
                Either::Second(done) => return Ok(Some(done)),
            }
        }
    }
}

/// A time that is known roughly.
pub(super) struct About(pub(super) Duration);

impl fmt::Display for About {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.as_secs() + 1 {
            seconds @ ..120 => write!(f, "{seconds}s"),
            seconds => write!(f, "{}m", seconds / 60),
        }
    }
}
