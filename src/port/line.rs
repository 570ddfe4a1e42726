//! An open serial line: what is heard is gathered, with the time of the last activity; what is sent is timed.
//!
//! The time that a frame spends on the wire is computed, not waited for, unless the gateway itself must switch the
//! transceiver's driver off behind it. An adapter that hears itself gives its own frame back first: that echo is compared
//! and dropped.

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

/// Bytes that may be heard and not yet understood: a frame, and as much noise again, or half of it with the feature `small`.
const RECEIVE_BYTES_MAX: usize =
    if cfg!(feature = "small") { rtu::FRAME_BYTES_MAX * 3 / 2 } else { rtu::FRAME_BYTES_MAX * 2 };
/// A line that takes no bytes for so long beyond their time on the wire is lost.
const STUCK: Duration = Duration::from_secs(2);
/// The line is gone and must be opened again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct LineLost;

/// The echo of a frame was not the frame: somebody else was sending.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Collision;

/// An open line, its timing, and what was heard on it.
pub(crate) struct Line<'s, L> {
    io: L,
    pub(crate) settings: &'s LineSettings,
    /// How late a read may be behind the wire, on this board.
    pub(crate) jitter: Duration,
    pub(crate) stats: &'s Counters,
    /// The last activity that is known of, by anybody.
    pub(crate) active: Instant,
    received: [u8; RECEIVE_BYTES_MAX],
    length: usize,
    /// What the receiver found wrong with that.
    flaws: Flaws,
    /// When what was heard began, and the silence before it.
    begun: Instant,
    pause: Duration,
    /// Since when characters have been sent without a pause, and how many.
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

    /// What was heard and not consumed.
    pub(crate) fn received(&self) -> &[u8] {
        self.received.get(..self.length).unwrap_or(&[])
    }

    /// When what was heard began, as its length and the last character's arrival tell. Behind a PTY, which has no speed,
    /// that may seem to be before the clock began.
    pub(crate) fn begun(&self) -> Instant {
        self.begun
    }

    /// The silence before what was heard.
    pub(crate) fn pause(&self) -> Duration {
        self.pause
    }

    /// Whether that is more than an RTU frame may have inside.
    pub(crate) fn pauses(&self) -> bool {
        self.pause > self.settings.t1_5() + self.jitter
    }

    /// Drops the first `count` bytes of what was heard.
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

    /// Drops what was heard.
    pub(crate) fn clear(&mut self) {
        self.length = 0;
        self.flaws = Flaws::default();
    }

    /// Why what was heard is not what was sent, if the receiver has seen that.
    pub(crate) fn flaw(&self) -> Option<Event> {
        match self.flaws {
            Flaws { framing: 0, parity: 0, .. } => None,
            Flaws { framing: 0, .. } => Some(Event::Parity),
            _ => Some(Event::Framing),
        }
    }

    /// Notes the characters that the receiver found faulty.
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

    /// When the line will have been silent for the gap.
    pub(crate) fn silent_at(&self) -> Instant {
        self.active + self.settings.gap()
    }

    /// When a `silence` may have told that nothing more comes. While the board passes on what comes, it watches the silence, and lets us
    /// read when it has come; unless nothing has come since it began, which was no later than a silence ago: that is to be looked for.
    pub(crate) fn quiet_at(&self, silence: Duration) -> Instant {
        let end = self.active + silence;
        match self.is_relayed() {
            false => end,
            true if Instant::now() > end + silence => Instant::MAX,
            true => end.max(Instant::now() + silence),
        }
    }

    /// Reads what is there behind what was heard already.
    pub(crate) async fn read(&mut self) -> Result<(), LineLost> {
        if self.length >= rtu::FRAME_BYTES_MAX {
            // Nobody talks that long: keep the newest part, in which a response may be.
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
                // A read can be late, and make a beginning seem late, but not early: the earliest is the best to go by.
                self.begun = self.begun.min(begun);
                self.length += count;
                Ok(())
            }
        }
    }

    /// Lets characters gather until `until`, where the board likes that better than to read each as it comes. Says whether that
    /// time has passed; nobody has looked at the line meanwhile.
    pub(crate) fn rest(&mut self, until: Instant) -> impl Future<Output = bool> {
        self.io.rest(until)
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
        match within(on_wire + STUCK, pin!(self.io.write_all(frame))).await {
            Some(Ok(())) => {}
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
        let patience = self.active.saturating_duration_since(now) + STUCK;
        match within(patience, pin!(self.io.write_all(characters))).await {
            Some(Ok(())) => Ok(()),
            _ => Err(LineLost),
        }
    }

    /// Lets the board send more characters of a frame, those that the line `from` is about to hear. Says whether it does.
    pub(crate) fn relay(&mut self, from: &str, relay: Relay) -> bool {
        self.io.relay(from, relay)
    }

    /// Ends that, and gives the number of characters that were sent since `begun`.
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

    /// Whether the board is sending at another line what this one hears: then it watches the silence here, and `read` gives
    /// what has come when that is over, if anything has.
    pub(crate) fn is_relayed(&self) -> bool {
        self.io.is_relayed()
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
            let received = self.received();
            let same = received.iter().zip(missing).take_while(|(received, sent)| received == sent).count();
            if same < received.len().min(missing.len()) {
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
