//! Byte streams over TCP: splits what a client sends into requests, and encodes responses, by Modbus TCP or RTU over TCP.

use embassy_time::{Duration, Instant};

use crate::modbus::PduLength;
use crate::modbus::rtu::{self, Cut};
use crate::modbus::tcp::{self, ADU_BYTES_MAX, Header, MbapError, Parsed};
use crate::settings::StreamFraming;
use crate::stats::Event;

/// The pause that ends an RTU frame over TCP whose function does not give a length. A stream has no silences; this is enough for
/// a serial device server to send the rest of a frame, and for a network to deliver it.
pub(crate) const RTU_PAUSE: Duration = Duration::from_millis(100);

/// Bytes of a frame written to a connection at a time: all, or with the feature `small` a part, to keep futures small. On a small
/// board, pieces still leave in one segment: its network stack sends when its task runs, not at each write.
const PIECE_BYTES: usize = if cfg!(feature = "small") { 64 } else { ADU_BYTES_MAX };

/// An outgoing frame, encoded piece by piece.
pub(crate) struct Pieces {
    piece: [u8; PIECE_BYTES],
    length: usize,
    given: usize,
}

impl Pieces {
    /// No piece has been taken.
    pub(crate) const fn new() -> Self {
        Self { piece: [0; PIECE_BYTES], length: 0, given: 0 }
    }

    /// Whether no piece has been taken yet.
    pub(crate) fn is_new(&self) -> bool {
        self.given == 0
    }

    /// Encodes the next piece of the frame of `pdu`. The first call also passes the whole frame to `begins`.
    pub(crate) fn take(
        &mut self,
        framing: StreamFraming,
        header: Header,
        pdu: &[u8],
        begins: impl FnOnce(&[u8]),
    ) {
        // Most frames, of either framing, are short: one piece, without a copy.
        if tcp::HEADER_BYTES + pdu.len() < PIECE_BYTES {
            let frame = encode(framing, header, pdu, &mut self.piece).unwrap_or(&[]);
            begins(frame);
            self.length = frame.len();
        } else {
            let mut frame = [0; ADU_BYTES_MAX];
            let frame = encode(framing, header, pdu, &mut frame).unwrap_or(&[]);
            if self.is_new() {
                begins(frame);
            }
            let rest = frame.get(self.given..).unwrap_or(&[]);
            self.length = rest.len().min(PIECE_BYTES);
            if let (Some(to), Some(from)) = (self.piece.get_mut(..self.length), rest.get(..self.length)) {
                to.copy_from_slice(from);
            }
        }
        self.given += self.length;
    }

    /// The current piece.
    pub(crate) fn piece(&self) -> &[u8] {
        self.piece.get(..self.length).unwrap_or(&[])
    }

    /// Whether more may follow.
    pub(crate) fn goes_on(&self) -> bool {
        self.length == PIECE_BYTES
    }
}

/// Received bytes that have not been consumed.
pub(crate) struct Input {
    framing: StreamFraming,
    bytes: [u8; ADU_BYTES_MAX],
    length: usize,
    /// When the last bytes arrived.
    received_at: Instant,
}

impl Input {
    /// Nothing has been received.
    pub(crate) const fn new(framing: StreamFraming) -> Self {
        Self { framing, bytes: [0; ADU_BYTES_MAX], length: 0, received_at: Instant::MIN }
    }

    /// The frame at the front, or why the stream cannot be decoded. RTU has no transaction id, so it is 0.
    pub(crate) fn front(&self) -> Result<Parsed<'_>, MbapError> {
        let received = self.bytes.get(..self.length).unwrap_or(&[]);
        if self.framing == StreamFraming::Mbap {
            return tcp::parse(received);
        }
        let cut = match rtu::request(received) {
            Cut::Incomplete if self.is_over() => rtu::request_at_pause(received),
            cut => cut,
        };
        Ok(match cut {
            Cut::Incomplete => Parsed::Incomplete,
            Cut::Request { unit, pdu, consumed } => {
                Parsed::Frame { header: Header { transaction: 0, unit }, pdu, consumed }
            }
            Cut::Noise { consumed } => Parsed::Skip { consumed },
        })
    }

    /// The first `count` bytes.
    pub(crate) fn first(&self, count: usize) -> &[u8] {
        self.bytes.get(..count.min(self.length)).unwrap_or(&[])
    }

    /// The event to count for skipped bytes.
    pub(crate) fn skip_event(&self) -> Event {
        match self.framing {
            StreamFraming::Mbap => Event::Malformed,
            StreamFraming::Rtu | StreamFraming::Capture | StreamFraming::Ssh => Event::Noise,
        }
    }

    /// Drops `count` bytes at the front.
    pub(crate) fn consume(&mut self, count: usize) {
        self.bytes.copy_within(count.min(self.length)..self.length, 0);
        self.length = self.length.saturating_sub(count);
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// Free space for reading.
    pub(crate) fn space(&mut self) -> &mut [u8] {
        self.bytes.get_mut(self.length..).unwrap_or(&mut [])
    }

    /// Adds `count` bytes that were read into the free space.
    pub(crate) fn grew(&mut self, count: usize) {
        self.length += count;
        if self.framing == StreamFraming::Rtu {
            self.received_at = Instant::now();
        }
    }

    /// When to examine the bytes again if nothing else arrives.
    pub(crate) fn pause_end(&self) -> Instant {
        let waits = self.framing == StreamFraming::Rtu && self.length > 0;
        if waits { self.received_at + RTU_PAUSE } else { Instant::MAX }
    }

    fn is_over(&self) -> bool {
        self.pause_end() <= Instant::now()
    }
}

/// Encodes a response into `out` and returns the bytes used.
fn encode<'a>(
    framing: StreamFraming,
    header: Header,
    response: &[u8],
    out: &'a mut [u8],
) -> Result<&'a [u8], PduLength> {
    match framing {
        StreamFraming::Mbap => tcp::encode(header, response, out),
        StreamFraming::Rtu | StreamFraming::Capture | StreamFraming::Ssh => {
            rtu::encode(header.unit, response, out)
        }
    }
}
