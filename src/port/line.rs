//! An open serial line: collects received bytes and the time of the last activity, and times what is sent.
//!
//! The time a frame spends on the wire is computed rather than waited for, unless the gateway itself must switch off the
//! transceiver's driver after it. An adapter that receives its own transmission delivers that echo first; it is compared and
//! dropped.

use core::pin::pin;

use embassy_time::{Duration, Instant, TimeoutError, Timer, with_deadline, with_timeout};

use crate::hal::{Flaws, Relay, SerialLine};
use crate::modbus::rtu;
use crate::port::timer::within;
use crate::settings::{Driver, LineSettings};
use crate::stats::{Counters, Event};

pub(crate) mod framing;
mod opening;
pub mod sniffer;

pub(crate) use opening::Opening;

/// Receive buffer: a frame and as much noise again, or half as much with the feature `small`.
const RECEIVE_BYTES_MAX: usize =
    if cfg!(feature = "small") { rtu::FRAME_BYTES_MAX * 3 / 2 } else { rtu::FRAME_BYTES_MAX * 2 };
/// A line that accepts no bytes for this long beyond their time on the wire is lost.
const STUCK: Duration = Duration::from_secs(2);
/// The line is lost and must be reopened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct LineLost;

/// The echo differs from the frame sent: another device was sending too.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Collision;

/// An open line, its timing, and the bytes received on it.
pub(crate) struct Line<'s, L> {
    io: L,
    pub(crate) settings: &'s LineSettings,
    /// How far reads may lag behind the wire on this board.
    pub(crate) jitter: Duration,
    pub(crate) stats: &'s Counters,
    /// The last known activity of any device.
    pub(crate) active: Instant,
    received: [u8; RECEIVE_BYTES_MAX],
    length: usize,
    /// Errors the receiver reported for the received bytes.
    flaws: Flaws,
    /// When the received bytes began, and the silence before them.
    begun: Instant,
    pause: Duration,
    /// Start and length of the current run of characters sent without a pause.
    run: (Instant, usize),
}

impl<'s, L: SerialLine> Line<'s, L> {
    fn new(io: L, settings: &'s LineSettings, jitter: Duration, stats: &'s Counters) -> Self {
        let active = Instant::now();
        Self {
            io,
            settings,
            jitter,
            stats,
            active,
            received: [0; RECEIVE_BYTES_MAX],
            length: 0,
            flaws: Flaws::default(),
            begun: active,
            pause: Duration::from_ticks(0),
            run: (active, 0),
        }
    }

    /// Bytes received and not consumed.
    pub(crate) fn received(&self) -> &[u8] {
        self.received.get(..self.length).unwrap_or(&[])
    }

    /// When the received bytes began, computed from their number and the arrival of the last one. On a PTY, which has no speed,
    /// that may precede the start of the clock.
    pub(crate) fn begun(&self) -> Instant {
        self.begun
    }

    /// The silence before the received bytes.
    pub(crate) fn pause(&self) -> Duration {
        self.pause
    }

    /// Whether that silence is longer than any allowed inside an RTU frame.
    pub(crate) fn pauses(&self) -> bool {
        self.pause > self.settings.t1_5() + self.jitter
    }

    /// Drops the first `count` received bytes.
    pub(crate) fn consume(&mut self, count: usize) {
        let count = count.min(self.length);
        if count == 0 {
            return;
        }
        self.begun += self.settings.chars(count);
        self.pause = Duration::from_ticks(0);
        self.received.copy_within(count..self.length, 0);
        self.length -= count;
    }

    /// Drops the received bytes.
    pub(crate) fn clear(&mut self) {
        self.length = 0;
        self.flaws = Flaws::default();
    }

    /// The receiver's explanation for corrupt bytes, if it has one.
    pub(crate) fn flaw(&self) -> Option<Event> {
        match self.flaws {
            Flaws { framing: 0, parity: 0, .. } => None,
            Flaws { framing: 0, .. } => Some(Event::Parity),
            _ => Some(Event::Framing),
        }
    }

    /// Counts the characters that the receiver found faulty.
    fn note_flaws(&mut self) {
        let flaws = self.io.take_flaws();
        if flaws == Flaws::default() {
            return;
        }
        let Flaws { parity, framing, overruns } = flaws;
        self.stats.add(Event::Overrun, overruns);
        self.stats.add(Event::Parity, parity);
        self.stats.add(Event::Framing, framing);
        self.flaws.parity = self.flaws.parity.saturating_add(parity);
        self.flaws.framing = self.flaws.framing.saturating_add(framing);
    }

    /// When the line has been silent for the gap.
    pub(crate) fn silent_at(&self) -> Instant {
        self.active + self.settings.gap()
    }

    /// When `silence` after the last byte may be over. While the board relays, it detects the silence and wakes the reader then,
    /// except for a silence that began before the relay: that one is timed here.
    pub(crate) fn quiet_at(&self, silence: Duration) -> Instant {
        let end = self.active + silence;
        match self.is_relayed() {
            false => end,
            true if Instant::now() > end + silence => Instant::MAX,
            true => end.max(Instant::now() + silence),
        }
    }

    /// Reads what is available and appends it.
    pub(crate) async fn read(&mut self) -> Result<(), LineLost> {
        if self.length >= rtu::FRAME_BYTES_MAX {
            // Longer than any frame: keep the newest part, which may contain a response.
            self.consume(self.length - rtu::FRAME_BYTES_MAX / 2);
        }
        match self.io.read(self.received.get_mut(self.length..).unwrap_or(&mut [])).await {
            Ok(0) | Err(_) => Err(LineLost),
            Ok(count) => {
                self.note_flaws();
                let before = self.active;
                self.active = Instant::now().saturating_sub(self.io.silence());
                let since = self.active.checked_sub(self.settings.chars(self.length + count));
                let begun = since.unwrap_or(Instant::MIN);
                if self.length == 0 {
                    self.begun = begun;
                    self.pause = begun.saturating_duration_since(before);
                }
                // A late read makes the start seem late, never early, so the earliest estimate is best.
                self.begun = self.begun.min(begun);
                self.length += count;
                Ok(())
            }
        }
    }

    /// Lets the next read wait for `characters`; 1 ends that. Returns whether the board does it.
    pub(crate) fn gather(&mut self, characters: usize) -> bool {
        self.io.gather(characters)
    }

    /// Rests until all but the last of `characters` that are missing should have come. That one is awaited by reading: a sleep until it
    /// is due would end slightly late.
    pub(crate) fn rest_before(&mut self, characters: usize) -> impl Future<Output = bool> {
        self.rest(self.begun + self.settings.chars(self.length + characters - 1))
    }

    /// Lets characters accumulate until `until`, if the board prefers that to reading each one. Returns whether that time has
    /// passed without a read.
    pub(crate) fn rest(&mut self, until: Instant) -> impl Future<Output = bool> {
        self.io.rest(until)
    }

    /// Sends `frame`; bytes received before are dropped. The line counts as active until the last bit has left.
    pub(crate) async fn send(&mut self, frame: &[u8]) -> Result<Result<(), Collision>, LineLost> {
        self.clear();
        let switched = self.settings.driver == Driver::Rts;
        if switched {
            self.drive(true).await?;
            Timer::after(self.settings.driver_before).await;
        }
        let on_wire = self.settings.chars(frame.len());
        let end = Instant::now() + on_wire;
        match within(on_wire + STUCK, pin!(self.io.write_all(frame))).await {
            Some(Ok(())) => {}
            _ => return Err(LineLost),
        }
        if switched {
            // Not before the last stop bit has left, or receivers see a break.
            Timer::at(end + self.settings.driver_after).await;
            self.drive(false).await?;
        }
        self.active = end.max(Instant::now());
        if self.settings.echo { self.take_echo(frame).await } else { Ok(Ok(())) }
    }

    /// Begins a frame whose characters follow by [`Line::feed`], until [`Line::end`]; bytes received before are dropped.
    pub(crate) fn begin(&mut self) {
        self.clear();
        self.run = (Instant::now(), 0);
        self.io.hold_driver(true);
    }

    /// Ends the frame.
    pub(crate) fn end(&mut self) {
        self.io.hold_driver(false);
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
        let patience = self.active.saturating_duration_since(now) + STUCK;
        match within(patience, pin!(self.io.write_all(characters))).await {
            Some(Ok(())) => Ok(()),
            _ => Err(LineLost),
        }
    }

    /// Lets the board relay more characters of a frame, as they arrive on the line `from`; returns whether it does.
    pub(crate) fn relay(&mut self, from: &str, relay: Relay) -> bool {
        self.io.relay(from, relay)
    }

    /// Ends the relay; returns the number of characters sent since `begun`.
    pub(crate) fn end_relay(&mut self, begun: &Relay) -> usize {
        let count = self.io.end_relay().map_or(0, |relay| relay.sent_since(begun));
        self.run.1 += count;
        let (since, sent) = self.run;
        let (end, now) = (since + self.settings.chars(sent), Instant::now());
        if end < now {
            self.run = (now, 0);
        }
        self.active = end.max(now);
        count
    }

    /// Whether the board is relaying what this line receives: then the board detects silence, and `read` returns what has arrived
    /// once the line is silent.
    /// arrived once the line is silent.
    pub(crate) fn is_relayed(&self) -> bool {
        self.io.is_relayed()
    }

    async fn drive(&mut self, on: bool) -> Result<(), LineLost> {
        match with_timeout(STUCK, self.io.drive(on)).await {
            Ok(Ok(())) => Ok(()),
            _ => Err(LineLost),
        }
    }

    /// Removes the echo of `frame` from the received bytes.
    async fn take_echo(&mut self, frame: &[u8]) -> Result<Result<(), Collision>, LineLost> {
        let sent = self.active;
        let until = sent + self.settings.gap() + self.jitter;
        let mut echoed = 0;
        while let Some(missing) = frame.get(echoed..).filter(|missing| !missing.is_empty()) {
            match with_deadline(until, self.read()).await {
                Ok(read) => read?,
                Err(TimeoutError) => break,
            }
            let received = self.received();
            let same = received.iter().zip(missing).take_while(|(received, sent)| received == sent).count();
            if same < received.len().min(missing.len()) {
                break;
            }
            echoed += same;
            self.consume(same);
        }
        if echoed == frame.len() {
            // The echo is the gateway's own activity and may be read late, so its read time does not count.
            self.active = if self.length == 0 { sent } else { self.active };
            return Ok(Ok(()));
        }
        self.active = self.active.max(sent);
        self.stats.count(Event::Collision);
        Ok(Err(Collision))
    }
}
