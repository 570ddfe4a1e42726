//! Counters of a port, by event, and the ring of the last transactions.

use core::sync::atomic::{AtomicU8, AtomicU32, Ordering};

use embassy_time::Instant;

pub use self::log::{LOG_ENTRIES_MAX, Log, LogEntry, Outcome};
use crate::frame::Cause;
use crate::modbus::Exception;
use crate::modbus::pdu::{self, EXCEPTION_BIT};

mod log;
pub mod response_tail;

/// What a port counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// A request came in from an outside client, or left for an outside server.
    Request,
    /// A response went out to an outside client, or came in from an outside server; exceptions included.
    Response,
    /// Of the responses, those that are exceptions.
    Exception,
    /// No response in time.
    Timeout,
    /// Of the time-outs, those in which nothing at all was heard.
    Silent,
    /// Characters that came before those before them were taken, as the line's receiver tells.
    Overrun,
    /// A response with a bad check or cut short.
    Corrupt,
    /// Of the damaged responses, those that were whole, but with a bad CRC or LRC.
    BadCheck,
    /// Of the damaged responses, those whose end was missing.
    Short,
    /// A character with a wrong parity bit, as the line's receiver tells.
    Parity,
    /// A character without its stop bit, as the line's receiver tells: another speed or format, or the wires are swapped.
    Framing,
    /// Bytes that are no frame.
    Noise,
    /// A response of another unit than the one asked.
    WrongUnit,
    /// A response that does not fit the request; often a late one to an earlier request.
    Misfit,
    /// A response on a serial line that came when its time was over.
    Late,
    /// A good frame of a unit on a serial line that answers nothing that was sent to it.
    Unsolicited,
    /// The gateway's own request came back: the line hears itself, and its settings do not say `echo`.
    Echo,
    /// A request by which a unit was to prove that it has answered all earlier ones.
    Proof,
    /// A read sent once more.
    Retry,
    /// A read that shared the transaction of another one.
    Merged,
    /// A transaction of several reads that the unit refused, so that each was sent by itself.
    Parted,
    /// A read that was answered from memory.
    Cached,
    /// Failed at once because the unit is down.
    UnitDown,
    /// Not sent: its time was over before its turn came.
    Expired,
    /// Not sent, or its response dropped: the requester is gone.
    RequesterGone,
    /// Refused: too many wait.
    QueueFull,
    /// Refused by a rule's function policy, or malformed.
    Refused,
    /// A write that a rule forbids, answered as if it had been carried out.
    Ignored,
    /// No rule, or the port that the rule names is off.
    NoPath,
    /// Dropped by a `discard` rule.
    Discarded,
    /// The port could not read on because its share of frames was in use.
    BackPressure,
    /// A response that no open request waits for: a late one, or one with an unknown transaction id.
    Stray,
    /// A connection was accepted, or made.
    Connected,
    /// A connection was closed by the other side.
    Left,
    /// A connection was closed, or a datagram dropped, because its address is not allowed.
    Unwelcome,
    /// A connection was closed to make room, or refused because there was none.
    Crowded,
    /// A connection was closed because its client was silent or did not read.
    Stalled,
    /// A request that came twice, and was not carried out again.
    Duplicate,
    /// Bytes from a client that are no Modbus TCP, or a frame of a MainDevice that is not whole.
    Malformed,
    /// The line, or the connection to a server, was lost and is opened again.
    LineLost,
    /// Somebody else was sending at the same time: the echo of a frame was not the frame.
    Collision,
    /// A client was answered 06h.
    Busy,
    /// A frame for or from another unit on a shared bus.
    Foreign,
    /// A frame that was passed on while it arrived at another serial line.
    Cut,
    /// A request of a master on another serial line, or the response to one, that was sent when it was whole.
    Stored,
    /// A frame that was begun while it arrived, and did not come to a good end.
    Aborted,
}

impl Event {
    /// Every event, in the order in which they are shown.
    pub const ALL: [Self; 46] = [
        Self::Request,
        Self::Response,
        Self::Exception,
        Self::Timeout,
        Self::Silent,
        Self::Overrun,
        Self::Corrupt,
        Self::BadCheck,
        Self::Short,
        Self::Parity,
        Self::Framing,
        Self::Noise,
        Self::WrongUnit,
        Self::Misfit,
        Self::Late,
        Self::Unsolicited,
        Self::Echo,
        Self::Proof,
        Self::Retry,
        Self::Merged,
        Self::Parted,
        Self::Cached,
        Self::UnitDown,
        Self::Expired,
        Self::RequesterGone,
        Self::QueueFull,
        Self::Refused,
        Self::Ignored,
        Self::NoPath,
        Self::Discarded,
        Self::BackPressure,
        Self::Stray,
        Self::Connected,
        Self::Left,
        Self::Unwelcome,
        Self::Crowded,
        Self::Stalled,
        Self::Duplicate,
        Self::Malformed,
        Self::LineLost,
        Self::Collision,
        Self::Busy,
        Self::Foreign,
        Self::Cut,
        Self::Stored,
        Self::Aborted,
    ];

    /// Its name in `show stats`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Request => "requests",
            Self::Response => "answers",
            Self::Exception => "exceptions",
            Self::Timeout => "timeouts",
            Self::Silent => "silent",
            Self::Overrun => "overruns",
            Self::Corrupt => "damaged",
            Self::BadCheck => "bad-crc",
            Self::Short => "short",
            Self::Parity => "parity",
            Self::Framing => "framing",
            Self::Noise => "noise",
            Self::WrongUnit => "wrong-unit",
            Self::Misfit => "misfit",
            Self::Late => "late",
            Self::Unsolicited => "unsolicited",
            Self::Echo => "echo",
            Self::Proof => "proofs",
            Self::Retry => "retries",
            Self::Merged => "merged",
            Self::Parted => "parted",
            Self::Cached => "cached",
            Self::UnitDown => "unit-down",
            Self::Expired => "expired",
            Self::RequesterGone => "asker-gone",
            Self::QueueFull => "queue-full",
            Self::Refused => "refused",
            Self::Ignored => "ignored",
            Self::NoPath => "no-path",
            Self::Discarded => "discarded",
            Self::BackPressure => "back-pressure",
            Self::Stray => "stray",
            Self::Connected => "connected",
            Self::Left => "left",
            Self::Unwelcome => "unwelcome",
            Self::Crowded => "crowded",
            Self::Stalled => "stalled",
            Self::Duplicate => "duplicates",
            Self::Malformed => "malformed",
            Self::LineLost => "line-lost",
            Self::Collision => "collisions",
            Self::Busy => "busy",
            Self::Foreign => "foreign",
            Self::Cut => "cut",
            Self::Stored => "stored",
            Self::Aborted => "aborted",
        }
    }
}

/// What went wrong last at a serial port, with the numbers that controllers show for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum LastError {
    /// Nothing.
    None = 0,
    /// The line could not be opened.
    Port = 3,
    /// A bad CRC or LRC.
    Checksum = 4,
    /// A frame too short, or with a length that its function cannot have.
    Length = 5,
    /// A request for an address that is not there (exception 02).
    Address = 6,
    /// A request with a function that is not there or not allowed (exception 01).
    Function = 7,
    /// A read of more than a response can hold (exception 03).
    Response = 8,
    /// A request with a value or quantity that cannot be (exception 03).
    Value = 9,
    /// Too wide a gap between two characters.
    Gap = 10,
    /// An ASCII frame that is too long, has an unexpected character, or no line feed.
    Ascii = 11,
    /// The line has not been opened yet.
    NotStarted = 12,
}

impl LastError {
    /// Every cause; first that of a port at the start, so that counters are all zeros then.
    pub const ALL: [Self; 11] = [
        Self::NotStarted,
        Self::None,
        Self::Port,
        Self::Checksum,
        Self::Length,
        Self::Address,
        Self::Function,
        Self::Response,
        Self::Value,
        Self::Gap,
        Self::Ascii,
    ];

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

/// One counter for each event, which wraps around; and what went wrong last.
pub struct Counters {
    events: [AtomicU32; Event::ALL.len()],
    /// Place in [`LastError::ALL`].
    last_error: AtomicU8,
    /// The clock's seconds when they were all zero.
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

    /// Notes what went wrong.
    pub fn note(&self, error: LastError) {
        let index = LastError::ALL.iter().position(|known| *known == error).unwrap_or(0);
        self.last_error.store(index as u8, Ordering::Relaxed);
    }

    /// Notes what is wrong with a request that is answered by `exception` at once.
    pub(crate) fn note_refused(&self, request: &[u8], exception: Exception) {
        let cause = if pdu::is_beyond_response(request) { Cause::Length } else { Cause::Silence };
        self.note_exception(exception, cause);
    }

    /// Counts a response that goes to a client; `cause` is behind it if it is an exception of the gateway.
    pub(crate) fn answered(&self, response: &[u8], cause: Cause) {
        self.count(Event::Response);
        if let [function, code] = *response
            && function & EXCEPTION_BIT != 0
        {
            self.count(Event::Exception);
            self.note_exception(Exception(code), cause);
        }
    }

    /// Notes what an exception that a client gets says of its request.
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

    /// What went wrong last.
    pub fn last_error(&self) -> LastError {
        let index = self.last_error.load(Ordering::Relaxed);
        LastError::ALL.get(usize::from(index)).copied().unwrap_or(LastError::None)
    }

    /// Counts `event`.
    pub fn count(&self, event: Event) {
        self.add(event, 1);
    }

    /// Counts `event` so many `times`.
    pub(crate) fn add(&self, event: Event, times: u32) {
        if let Some(counter) = self.events.get(event as usize) {
            counter.fetch_add(times, Ordering::Relaxed);
        }
    }

    /// How often `event` was counted in a minute, on the average since the counters were zero.
    pub fn per_minute(&self, event: Event, now: Instant) -> u32 {
        let seconds = now.as_secs().saturating_sub(self.since_s.load(Ordering::Relaxed).into()).max(1);
        u32::try_from(u64::from(self.get(event)) * 60 / seconds).unwrap_or(u32::MAX)
    }

    /// Sets one counter to zero.
    pub(crate) fn reset(&self, event: Event) {
        if let Some(counter) = self.events.get(event as usize) {
            counter.store(0, Ordering::Relaxed);
        }
    }

    /// How often `event` was counted.
    pub fn get(&self, event: Event) -> u32 {
        self.events.get(event as usize).map_or(0, |counter| counter.load(Ordering::Relaxed))
    }

    /// Sets all to zero; a port that works has no last error any more.
    pub fn clear(&self, now: Instant) {
        self.since_s.store(now.as_secs() as u32, Ordering::Relaxed);
        if !matches!(self.last_error(), LastError::NotStarted | LastError::Port) {
            self.note(LastError::None);
        }
        self.events.iter().for_each(|counter| counter.store(0, Ordering::Relaxed));
    }
}

impl Default for Counters {
    fn default() -> Self {
        Self::new()
    }
}
