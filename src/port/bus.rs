//! One serial line seen from its client: waits for silence, sends a request, gathers the response.
//!
//! The end of a response is known by its length and CRC where the request tells the length, else by the silence that
//! ends every frame (Modbus over Serial Line 2.5.1.1). Bytes that are no answer to the request leave the response
//! timer running. The time that the request spends on the wire is computed, not waited for, and does not eat the
//! response time.

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant, TimeoutError, Timer, with_deadline, with_timeout};
use embedded_io_async::{Read, Write};

use crate::config::{LineSettings, SerialClientSettings};
use crate::modbus::rtu::{self, AtSilence, Received};
use crate::stats::{Counters, Event};

/// Bytes that may come between a request and the end of its response: a frame and as much noise again.
const RECEIVE_BYTES_MAX: usize = 2 * rtu::FRAME_BYTES_MAX;
/// A line that takes no bytes for so long beyond their time on the wire is lost.
const STUCK: Duration = Duration::from_secs(2);

/// The line is gone and must be opened again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct LineLost;

/// Why there is no response.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Failure {
    /// None came in time; it may still come.
    Timeout,
    /// It came damaged.
    Damaged,
}

/// An open line and its timing.
pub(crate) struct Bus<'s, L> {
    line: L,
    settings: LineSettings,
    client: SerialClientSettings,
    /// How late a read may be behind the wire, on this board.
    jitter: Duration,
    stats: &'s Counters,
    /// The last activity that is known of, by anybody.
    active: Instant,
    received: [u8; RECEIVE_BYTES_MAX],
    length: usize,
}

impl<'s, L: Read + Write> Bus<'s, L> {
    /// A line that was just opened; nothing is sent during the start delay.
    pub(crate) fn new(
        line: L,
        settings: LineSettings,
        client: SerialClientSettings,
        jitter: Duration,
        stats: &'s Counters,
    ) -> Self {
        let active = Instant::now() + client.start_delay;
        Self { line, settings, client, jitter, stats, active, received: [0; RECEIVE_BYTES_MAX], length: 0 }
    }

    /// Waits until the line has been silent for the gap; what comes meanwhile is dropped.
    pub(crate) async fn silence(&mut self) -> Result<(), LineLost> {
        loop {
            self.length = 0;
            let silent = self.active + self.settings.gap();
            match with_deadline(silent, self.read()).await {
                Ok(read) => {
                    read?;
                    self.stats.count(Event::Noise);
                }
                Err(TimeoutError) => return Ok(()),
            }
        }
    }

    /// Watches the idle line until `until` is over; what comes meanwhile is dropped.
    pub(crate) async fn idle<T>(&mut self, until: impl Future<Output = T>) -> Result<(), LineLost> {
        self.length = 0;
        match select(self.read(), until).await {
            Either::First(read) => {
                self.stats.count(Event::Noise);
                read
            }
            Either::Second(_) => Ok(()),
        }
    }

    /// Sends `request` to every unit and waits out the turnaround delay (Serial Line 2.4.1).
    pub(crate) async fn broadcast(&mut self, request: &[u8]) -> Result<(), LineLost> {
        self.send(0, request).await?;
        Timer::at(self.active + self.client.turnaround).await;
        Ok(())
    }

    /// Sends `request` to `unit`, hands the response PDU to `take`, and gives the time from the request's end to it.
    pub(crate) async fn exchange(
        &mut self,
        unit: u8,
        request: &[u8],
        take: impl FnOnce(&[u8]),
    ) -> Result<Result<Duration, Failure>, LineLost> {
        self.send(unit, request).await?;
        let sent = self.active;
        let outcome = self.response(unit, request, sent + self.client.timeout, take).await?;
        Ok(outcome.map(|()| self.active.saturating_duration_since(sent)))
    }

    async fn send(&mut self, unit: u8, request: &[u8]) -> Result<(), LineLost> {
        self.length = 0;
        let mut frame = [0; rtu::FRAME_BYTES_MAX];
        let frame = rtu::encode(unit, request, &mut frame).map_err(|_| LineLost)?;
        let on_wire = self.settings.chars(frame.len());
        let end = Instant::now() + on_wire;
        match with_timeout(on_wire + STUCK, self.line.write_all(frame)).await {
            Ok(Ok(())) => {}
            _ => return Err(LineLost),
        }
        self.active = end.max(Instant::now());
        self.stats.count(Event::Request);
        Ok(())
    }

    async fn response(
        &mut self,
        unit: u8,
        request: &[u8],
        deadline: Instant,
        take: impl FnOnce(&[u8]),
    ) -> Result<Result<(), Failure>, LineLost> {
        let silence = self.settings.char_timeout.unwrap_or(self.settings.gap()) + self.jitter;
        // A frame that has begun in time is heard to its end, but a line that babbles is not heard for ever.
        let end = deadline + self.settings.chars(rtu::FRAME_BYTES_MAX) + silence;
        loop {
            let until = if self.length == 0 { deadline } else { end.min(self.active + silence) };
            if let Ok(read) = with_deadline(until, self.read()).await {
                read?;
                if let Received::Complete(pdu) = rtu::response(unit, request, self.heard()) {
                    take(pdu);
                    return Ok(Ok(()));
                }
                continue;
            }
            if self.length == 0 {
                return Ok(Err(Failure::Timeout));
            }
            let event = match rtu::response_at_silence(unit, request, self.heard()) {
                AtSilence::Complete(pdu) => {
                    take(pdu);
                    return Ok(Ok(()));
                }
                AtSilence::Damaged => return Ok(Err(Failure::Damaged)),
                AtSilence::WrongUnit(_) => Event::WrongUnit,
                AtSilence::Misfit(_) => Event::Misfit,
                AtSilence::Noise => Event::Noise,
            };
            self.stats.count(event);
            self.length = 0;
            if Instant::now() >= deadline {
                return Ok(Err(Failure::Timeout));
            }
        }
    }

    fn heard(&self) -> &[u8] {
        self.received.get(..self.length).unwrap_or(&[])
    }

    /// Reads what is there behind what was received already.
    async fn read(&mut self) -> Result<(), LineLost> {
        if self.length >= rtu::FRAME_BYTES_MAX {
            // Nobody talks that long: keep the newest part, in which an answer may be.
            self.received.copy_within(self.length - rtu::FRAME_BYTES_MAX / 2..self.length, 0);
            self.length = rtu::FRAME_BYTES_MAX / 2;
        }
        match self.line.read(&mut self.received[self.length..]).await {
            Ok(0) | Err(_) => Err(LineLost),
            Ok(count) => {
                self.length += count;
                self.active = Instant::now();
                Ok(())
            }
        }
    }
}
