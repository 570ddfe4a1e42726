//! Counters of a port, by event, and the log of the last transactions.

use embassy_time::Instant;
use portable_atomic::{AtomicU8, AtomicU32, Ordering};
use strum::{IntoStaticStr, VariantArray};

pub use self::log::{LOG_ENTRIES_MAX, Log, LogEntry, Outcome};
use crate::frame::Cause;
use crate::modbus::Exception;
use crate::modbus::pdu::{self, EXCEPTION_BIT};

mod log;
#[doc(hidden)] // Public for tests/ only.
pub mod response_tail;

/// The events that a port counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, VariantArray, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum Event {
    /// A request was received from an outside client, or sent to an outside server.
    #[strum(serialize = "requests")]
    Request,
    /// A response was sent to an outside client, or received from an outside server; includes exceptions.
    #[strum(serialize = "responses")]
    Response,
    /// Of the responses, those that are exceptions.
    #[strum(serialize = "exceptions")]
    Exception,
    /// No response in time.
    #[strum(serialize = "timeouts")]
    Timeout,
    /// Of the time-outs, those in which nothing at all was received.
    Silent,
    /// Receiver overrun.
    #[strum(serialize = "overruns")]
    Overrun,
    /// A response that was corrupt or truncated.
    Corrupt,
    /// Of the corrupt responses, those with a bad CRC or LRC.
    #[strum(serialize = "bad-crc")]
    BadCheck,
    /// Of the corrupt responses, those that were truncated.
    Short,
    /// A character with a parity error.
    Parity,
    /// A character without a stop bit: a different speed or format, or swapped wires.
    Framing,
    /// Bytes that are not a frame.
    Noise,
    /// A response from another unit than the one asked.
    WrongUnit,
    /// A response that does not match the request; often a late one to an earlier request.
    Misfit,
    /// A response on a serial line after its time-out.
    Late,
    /// A valid frame from a unit on a serial line that matches nothing sent to it.
    Unsolicited,
    /// The echo of the gateway's own request, on a line whose settings do not say `echo`.
    Echo,
    /// A request sent to prove that a unit has answered all earlier ones.
    #[strum(serialize = "proofs")]
    Proof,
    /// A read that was repeated.
    #[strum(serialize = "retries")]
    Retry,
    /// A read that shared the transaction of another one.
    Merged,
    /// A combined read that the unit refused, so that its reads were sent one by one.
    Parted,
    /// A read that was answered from the cache.
    Cached,
    /// Failed at once because the unit is down.
    UnitDown,
    /// Not sent: expired while waiting.
    Expired,
    /// Not sent, or the response dropped: the requester is gone.
    #[strum(serialize = "requester-gone")]
    RequesterGone,
    /// Refused: the queue is full.
    QueueFull,
    /// Refused by a rule's function policy, or malformed.
    Refused,
    /// A write forbidden by a rule, but confirmed as if it had been executed.
    Ignored,
    /// No rule matches, or the rule's port is off.
    NoPath,
    /// Dropped by a `discard` rule.
    Discarded,
    /// Reading paused because the port's share of frames was in use.
    BackPressure,
    /// A response without a pending request: a late one, or one with an unknown transaction id.
    Stray,
    /// A connection was accepted or made.
    Connected,
    /// A connection was closed by the other side.
    Left,
    /// A connection was closed, or a datagram dropped, because the address is not allowed.
    Unwelcome,
    /// A connection was closed to make room, or refused because there was none.
    Crowded,
    /// A connection was closed because its client was idle or did not read.
    Stalled,
    /// A duplicate of an open request, which was not executed again.
    #[strum(serialize = "duplicates")]
    Duplicate,
    /// Bytes from a client that are not Modbus TCP, or an incomplete frame from a MainDevice.
    Malformed,
    /// The line, or the connection to a server, was lost and is reopened.
    LineLost,
    /// Another device was sending at the same time: the echo differed from the frame sent.
    #[strum(serialize = "collisions")]
    Collision,
    /// A client was answered 06h.
    Busy,
    /// A frame for or from another unit on a shared bus.
    Foreign,
    /// A frame that was cut through from another serial line.
    Cut,
    /// A request from a master on another serial line, or its response, that was sent only when complete.
    Stored,
    /// A cut-through frame that was broken off or turned out corrupt.
    Aborted,
}

impl Event {
    /// Every event, in display order.
    pub const ALL: &[Self] = Self::VARIANTS;

    /// Its name in `show stats`.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// The last error of a serial port, with the numbers that controllers display. The initial one comes first, so that the initial state
/// is all zeros.
#[derive(Debug, Clone, Copy, PartialEq, Eq, VariantArray)]
#[repr(u8)]
pub enum LastError {
    /// The line has not been opened yet.
    NotStarted = 12,
    /// No error.
    None = 0,
    /// The line could not be opened.
    Port = 3,
    /// A bad CRC or LRC.
    Checksum = 4,
    /// A frame too short, or with a length that its function cannot have.
    Length = 5,
    /// A request with an address that does not exist (exception 02).
    Address = 6,
    /// A request with a function that does not exist or is not allowed (exception 01).
    Function = 7,
    /// A read longer than a response can hold (exception 03).
    Response = 8,
    /// A request with an invalid value or quantity (exception 03).
    Value = 9,
    /// A gap between two characters that is too long.
    Gap = 10,
    /// An ASCII frame that is too long, has an invalid character, or lacks its line feed.
    Ascii = 11,
}

impl LastError {
    /// Its name in `show stats`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Port => "port not opened",
            Self::Checksum => "bad checksum",
            Self::Length => "bad length",
            Self::Address => "unmapped address",
            Self::Function => "unsupported function",
            Self::Response => "more than a response can hold",
            Self::Value => "bad data",
            Self::Gap => "gap between characters",
            Self::Ascii => "ASCII error",
            Self::NotStarted => "not started yet",
        }
    }
}

/// One wrapping counter per event, and the last error.
pub struct Counters {
    events: [AtomicU32; Event::ALL.len()],
    /// Index in `LastError::VARIANTS`.
    last_error: AtomicU8,
    /// The clock's seconds when the counters were cleared.
    since_s: AtomicU32,
}

impl Counters {
    /// All zero.
    pub const fn new() -> Self {
        Self {
            events: [const { AtomicU32::new(0) }; Event::ALL.len()],
            last_error: AtomicU8::new(0),
            since_s: AtomicU32::new(0),
        }
    }

    /// Sets the last error.
    pub fn note(&self, error: LastError) {
        let index = LastError::VARIANTS.iter().position(|known| *known == error).unwrap_or(0);
        self.last_error.store(index as u8, Ordering::Relaxed);
    }

    /// Sets the last error for a request refused with `exception`.
    pub(crate) fn note_refused(&self, request: &[u8], exception: Exception) {
        let cause = if pdu::is_beyond_response(request) { Cause::Length } else { Cause::Silence };
        self.note_exception(exception, cause);
    }

    /// Counts a response sent to a client; `cause` explains an exception of the gateway.
    pub(crate) fn answered(&self, response: &[u8], cause: Cause) {
        self.count(Event::Response);
        if let [function, code] = *response
            && function & EXCEPTION_BIT != 0
        {
            self.count(Event::Exception);
            self.note_exception(Exception(code), cause);
        }
    }

    /// Sets the last error by the exception that a client gets.
    fn note_exception(&self, exception: Exception, cause: Cause) {
        match (exception, cause) {
            (Exception::BUSY, _) => self.count(Event::Busy),
            (Exception::ILLEGAL_FUNCTION, _) => self.note(LastError::Function),
            (Exception::ILLEGAL_ADDRESS, _) => self.note(LastError::Address),
            (Exception::ILLEGAL_VALUE, Cause::Length) => self.note(LastError::Response),
            (Exception::ILLEGAL_VALUE, _) => self.note(LastError::Value),
            _ => {}
        }
    }

    /// The last error.
    pub fn last_error(&self) -> LastError {
        let index = self.last_error.load(Ordering::Relaxed);
        LastError::VARIANTS.get(usize::from(index)).copied().unwrap_or(LastError::None)
    }

    /// Counts `event`.
    pub fn count(&self, event: Event) {
        self.add(event, 1);
    }

    /// Counts `event` `times` times.
    pub(crate) fn add(&self, event: Event, times: u32) {
        if let Some(counter) = self.events.get(event as usize) {
            counter.fetch_add(times, Ordering::Relaxed);
        }
    }

    /// The average of `event` per minute since the counters were cleared.
    pub(crate) fn per_minute(&self, event: Event, now: Instant) -> u32 {
        let seconds = now.as_secs().saturating_sub(self.since_s.load(Ordering::Relaxed).into()).max(1);
        u32::try_from(u64::from(self.get(event)) * 60 / seconds).unwrap_or(u32::MAX)
    }

    /// Clears one counter.
    pub(crate) fn reset(&self, event: Event) {
        if let Some(counter) = self.events.get(event as usize) {
            counter.store(0, Ordering::Relaxed);
        }
    }

    /// The count of `event`.
    pub fn get(&self, event: Event) -> u32 {
        self.events.get(event as usize).map_or(0, |counter| counter.load(Ordering::Relaxed))
    }

    /// Clears all counters; a working port has no last error any more.
    pub fn clear(&self, now: Instant) {
        self.since_s.store(now.as_secs() as u32, Ordering::Relaxed);
        if !matches!(self.last_error(), LastError::NotStarted | LastError::Port) {
            self.note(LastError::None);
        }
        self.events.iter().for_each(|counter| counter.store(0, Ordering::Relaxed));
    }
}
