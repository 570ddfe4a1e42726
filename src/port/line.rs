//! An open serial line: what is heard is gathered, with the time of the last activity; what is sent is timed.
//!
//! The time that a frame spends on the wire is computed, not waited for, unless the gateway itself must switch the
//! transceiver's driver off behind it. An adapter that hears itself gives its own frame back first: that echo is compared
//! and dropped.

use embassy_time::{Duration, Instant, TimeoutError, Timer, with_deadline, with_timeout};

use crate::config::{Driver, LineSettings, SerialSettings};
use crate::gateway::{PortPlace, Status};
use crate::hal::{OpenError, SerialLine};
use crate::modbus::rtu;
use crate::stats::{Counters, Event, LastError};

/// Bytes that may be heard and not yet understood: a frame and as much noise again.
const RECEIVE_BYTES_MAX: usize = 2 * rtu::FRAME_BYTES_MAX;
/// A line that takes no bytes for so long beyond their time on the wire is lost.
const STUCK: Duration = Duration::from_secs(2);
/// First and longest pause before a line is opened again.
const REOPEN_FIRST: Duration = Duration::from_millis(250);
const REOPEN_LONGEST: Duration = Duration::from_secs(5);

/// The line is gone and must be opened again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct LineLost;

/// The echo of a frame was not the frame: somebody else was sending.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Collision;

/// An open line, its timing, and what was heard on it.
pub(crate) struct Line<'s, L> {
    io: L,
    pub(crate) settings: LineSettings,
    /// How late a read may be behind the wire, on this board.
    pub(crate) jitter: Duration,
    pub(crate) stats: &'s Counters,
    /// The last activity that is known of, by anybody.
    pub(crate) active: Instant,
    received: [u8; RECEIVE_BYTES_MAX],
    length: usize,
    /// Since when characters have been sent without a pause, and how many.
    run: (Instant, usize),
}

/// Opens a line again and again, with back-off, and tells how that goes.
pub(crate) struct Opening<'s> {
    place: &'s PortPlace,
    settings: &'s SerialSettings,
    pause: Duration,
}

impl<'s> Opening<'s> {
    pub(crate) fn new(place: &'s PortPlace, settings: &'s SerialSettings) -> Self {
        Self { place, settings, pause: REOPEN_FIRST }
    }

    /// The line that `host` has opened, if it has.
    pub(crate) fn opened<L: SerialLine>(
        &mut self,
        opened: Result<L, OpenError>,
        jitter: Duration,
    ) -> Option<Line<'s, L>> {
        let device = self.settings.device.as_str();
        match opened {
            Ok(io) => {
                log_info!("{} is open", device);
                self.place.set_status(Status::Open);
                self.place.stats.note(LastError::None);
                self.pause = REOPEN_FIRST;
                Some(Line::new(io, self.settings.line, jitter, &self.place.stats))
            }
            Err(error) => {
                self.place.stats.note(LastError::Port);
                if self.place.set_status(Status::Failed(error)) {
                    log_warn!("{} cannot be opened: {}", device, error);
                }
                None
            }
        }
    }

    /// The line is lost.
    pub(crate) fn lost(&self) {
        log_warn!("{} is lost", self.settings.device.as_str());
        self.place.stats.count(Event::LineLost);
        self.place.set_status(Status::Lost);
    }

    /// Waits before the next attempt.
    pub(crate) async fn pause(&mut self) {
        Timer::after(self.pause).await;
        self.pause = (self.pause * 2).min(REOPEN_LONGEST);
    }
}

impl<'s, L: SerialLine> Line<'s, L> {
    fn new(io: L, settings: LineSettings, jitter: Duration, stats: &'s Counters) -> Self {
        let active = Instant::now();
        let (received, run) = ([0; RECEIVE_BYTES_MAX], (active, 0));
        Self { io, settings, jitter, stats, active, received, length: 0, run }
    }

    /// What was heard and not consumed.
    pub(crate) fn heard(&self) -> &[u8] {
        self.received.get(..self.length).unwrap_or(&[])
    }

    /// When what was heard began, as its length and the last character's arrival tell. Behind a PTY, which has no speed,
    /// that may seem to be before the clock began.
    pub(crate) fn begun(&self) -> Instant {
        self.active.checked_sub(self.settings.chars(self.length)).unwrap_or(Instant::MIN)
    }

    /// Drops the first `count` bytes of what was heard.
    pub(crate) fn consume(&mut self, count: usize) {
        let count = count.min(self.length);
        self.received.copy_within(count..self.length, 0);
        self.length -= count;
    }

    /// Drops what was heard.
    pub(crate) fn clear(&mut self) {
        self.length = 0;
    }

    /// When the line will have been silent for the gap.
    pub(crate) fn silent_at(&self) -> Instant {
        self.active + self.settings.gap()
    }

    /// Reads what is there behind what was heard already.
    pub(crate) async fn read(&mut self) -> Result<(), LineLost> {
        if self.length >= rtu::FRAME_BYTES_MAX {
            // Nobody talks that long: keep the newest part, in which an answer may be.
            self.consume(self.length - rtu::FRAME_BYTES_MAX / 2);
        }
        match self.io.read(self.received.get_mut(self.length..).unwrap_or(&mut [])).await {
            Ok(0) | Err(_) => Err(LineLost),
            Ok(count) => {
                self.length += count;
                self.active = Instant::now();
                Ok(())
            }
        }
    }

    /// Lets characters gather until `until`, where the board likes that better than to read each as it comes. Nobody looks at
    /// the line meanwhile, so it counts as active.
    pub(crate) async fn rest(&mut self, until: Instant) {
        if self.io.rest(until).await {
            self.active = self.active.max(Instant::now());
        }
    }

    /// Sends `frame`; what was heard before is dropped. The line counts as active until its last bit has left.
    pub(crate) async fn send(&mut self, frame: &[u8]) -> Result<Result<(), Collision>, LineLost> {
        self.clear();
        let switched = self.settings.driver == Driver::Rts;
        if switched {
            self.drive(true).await?;
            Timer::after(self.settings.driver_before).await;
        }
        let on_wire = self.settings.chars(frame.len());
        let end = Instant::now() + on_wire;
        match with_timeout(on_wire + STUCK, self.io.write_all(frame)).await {
            Ok(Ok(())) => {}
            _ => return Err(LineLost),
        }
        if switched {
            // Not before the last stop bit has left: a receiver would take its end for a break.
            Timer::at(end + self.settings.driver_after).await;
            self.drive(false).await?;
        }
        self.active = end.max(Instant::now());
        if self.settings.echo { self.take_echo(frame).await } else { Ok(Ok(())) }
    }

    /// Begins a frame whose characters follow by [`Line::feed`]; what was heard before is dropped.
    pub(crate) fn begin(&mut self) {
        self.clear();
        self.run = (Instant::now(), 0);
    }

    /// Sends more `characters` of a frame.
    pub(crate) async fn feed(&mut self, characters: &[u8]) -> Result<(), LineLost> {
        let now = Instant::now();
        if self.active < now {
            self.run = (now, 0);
        }
        self.run.1 += characters.len();
        let (since, count) = self.run;
        self.active = since + self.settings.chars(count);
        match with_timeout(self.active.saturating_duration_since(now) + STUCK, self.io.write_all(characters))
            .await
        {
            Ok(Ok(())) => Ok(()),
            _ => Err(LineLost),
        }
    }

    async fn drive(&mut self, on: bool) -> Result<(), LineLost> {
        match with_timeout(STUCK, self.io.drive(on)).await {
            Ok(Ok(())) => Ok(()),
            _ => Err(LineLost),
        }
    }

    /// Takes the echo of `frame` off what is heard.
    async fn take_echo(&mut self, frame: &[u8]) -> Result<Result<(), Collision>, LineLost> {
        let sent = self.active;
        let until = sent + self.settings.gap() + self.jitter;
        let mut echoed = 0;
        while let Some(missing) = frame.get(echoed..).filter(|missing| !missing.is_empty()) {
            match with_deadline(until, self.read()).await {
                Ok(read) => read?,
                Err(TimeoutError) => break,
            }
            let heard = self.heard();
            let same = heard.iter().zip(missing).take_while(|(heard, sent)| heard == sent).count();
            if same < heard.len().min(missing.len()) {
                break;
            }
            echoed += same;
            self.consume(same);
        }
        if echoed == frame.len() {
            // The echo is the gateway's own activity, which may be read later than it was.
            self.active = if self.length == 0 { sent } else { self.active };
            return Ok(Ok(()));
        }
        self.active = self.active.max(sent);
        self.stats.count(Event::Collision);
        Ok(Err(Collision))
    }
}
