//! Bus sniffer: classifies frames on a serial line shared with other devices as a request for the gateway, a request for another
//! unit, that unit's response, or garbage. Pure; silences are passed in.
//! In RTU, a frame of another unit is ambiguous: the response to a read begins like a request. So after a request to another unit
//! its response is expected, and a frame that fits is taken for it; everything else is interpreted as a request. A frame with one
//! of the gateway's own ids is never another unit's response.
//! gateway's own ids is never another unit's response.
//!
//! Everything between two silences is first tried as a single frame. Where silences cannot be observed (an operating system's reads
//! are late) or were too short, frames are split by the lengths of both interpretations and by valid CRCs; a frame can only begin
//! where the previous one ended. A sniffer that has lost synchronisation, as after power-up, waits for a silence. ASCII frames are
//! delimited and need none of that.

use crate::modbus::Pdu;
use crate::modbus::pdu::{self, EXCEPTION_BIT, End, ResponseLength};
use crate::modbus::rtu::{self, FRAME_BYTES_MAX, FRAME_BYTES_MIN};
use crate::stats::LastError;

mod ascii;

pub use ascii::AsciiSniffer;

/// What was received.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sniffed<'a> {
    /// A request for one of the gateway's units, or a broadcast.
    Request {
        /// The unit id the master uses.
        unit: u8,
        /// Function code and data.
        pdu: &'a [u8],
    },
    /// A request for another unit.
    ForeignRequest,
    /// A response from another unit.
    ForeignResponse,
    /// Not a frame, with the reason.
    Garbage(LastError),
    /// Nothing complete yet.
    Nothing,
}

/// Sniffs an RTU line.
pub struct RtuSniffer {
    expected: Option<Foreign>,
    /// Whether the received bytes start at a frame boundary.
    in_step: bool,
}

/// A request to another unit whose response is expected.
struct Foreign {
    unit: u8,
    request: Pdu,
}

impl RtuSniffer {
    /// As after power-up: the line may be in the middle of a frame.
    pub const fn new() -> Self {
        Self { expected: None, in_step: false }
    }

    /// Whether only a silence can restore synchronisation, though nothing has been received.
    pub const fn needs_silence(&self) -> bool {
        !self.in_step
    }

    /// Classifies the beginning of `received`, all bytes not classified yet, and returns how many bytes that covers. `silent`: the
    /// line has been silent since. `is_ours` knows the gateway's units, including 0 if broadcasts are for it.
    ///
    /// Call again with the rest until it returns [`Sniffed::Nothing`].
    pub fn feed<'a>(
        &mut self,
        received: &'a [u8],
        silent: bool,
        is_ours: impl Fn(u8) -> bool,
    ) -> (Sniffed<'a>, usize) {
        let was_in_step = self.in_step;
        let whole = silent && was_in_step && is_whole(received);
        let frame = if whole {
            frame_of(received, received.len())
        } else {
            let all = || (silent && was_in_step).then(|| frame_of(received, received.len())).flatten();
            self.first(received, silent, &is_ours).or_else(all)
        };
        if let Some((end, unit, pdu)) = frame {
            self.in_step = true;
            let sniffed = match self.judge(unit, pdu, &is_ours) {
                // This may be data that looks like a frame. If it was a request, the master repeats it.
                Sniffed::Request { .. } if !was_in_step => Sniffed::ForeignResponse,
                sniffed => sniffed,
            };
            return (sniffed, end);
        }
        if silent {
            self.in_step = true;
            return match received {
                [] => (Sniffed::Nothing, 0),
                _ => {
                    self.expected = None;
                    (Sniffed::Garbage(garbage(received)), received.len())
                }
            };
        }
        if received.len() >= FRAME_BYTES_MAX {
            // Longer than any frame without containing one: synchronisation is lost.
            self.in_step = false;
            self.expected = None;
            return (Sniffed::Garbage(LastError::Length), 1);
        }
        (Sniffed::Nothing, 0)
    }

    /// The minimum length of the frame that begins `received`, all bytes not classified yet; `None` if that is not more than has
    /// arrived, or is unknown.
    pub fn at_least(&self, received: &[u8], is_ours: impl Fn(u8) -> bool) -> Option<usize> {
        let (&unit, so_far) = received.split_first().filter(|_| self.in_step)?;
        let request = match pdu::request_end(so_far) {
            End::At(length) => Some(length),
            End::Later | End::Unknown => None,
        };
        // The response to a missed request.
        let unknown = || match so_far {
            [1..=4, count, ..] => Some(2 + usize::from(*count)),
            [5 | 6 | 15 | 16, ..] => Some(5),
            _ => None,
        };
        let response = if is_ours(unit) {
            request
        } else {
            self.response_length(unit, so_far, &is_ours).or_else(unknown)
        };
        let (Some(request), Some(response)) = (request, response) else {
            return (received.len() < FRAME_BYTES_MIN).then_some(FRAME_BYTES_MIN);
        };
        let bytes = [request, response].map(|length| length + rtu::OVERHEAD_BYTES);
        // An interpretation whose length has been reached failed its CRC.
        bytes.into_iter().filter(|bytes| *bytes > received.len()).min()
    }

    /// The first interpretation of the frame that has enough bytes and a valid CRC.
    fn first<'a>(
        &self,
        received: &'a [u8],
        silent: bool,
        is_ours: &impl Fn(u8) -> bool,
    ) -> Option<(usize, u8, &'a [u8])> {
        let (&unit, so_far) = received.split_first()?;
        let whole = |length: usize| frame_of(received, length + rtu::OVERHEAD_BYTES);
        if let Some(length) = self.response_length(unit, so_far, is_ours) {
            match received.len() < length + rtu::OVERHEAD_BYTES {
                // The expected response may still be incomplete, and its data may look like a request.
                true if !silent => return None,
                _ => {
                    if let Some(frame) = whole(length) {
                        return Some(frame);
                    }
                }
            }
        }
        let as_request = pdu::request_length(so_far).and_then(whole);
        // The response to a missed request: a read's response carries its length.
        let unknown = || match so_far {
            [1..=4, count, ..] if !is_ours(unit) => whole(2 + usize::from(*count)),
            [function, _, ..] if function & EXCEPTION_BIT != 0 => whole(2),
            _ => None,
        };
        as_request.or_else(unknown).or_else(|| self.unlisted(received, is_ours))
    }

    /// A frame of another unit with a function of unknown length: it ends where the CRC is valid. For the gateway's units the
    /// silence is awaited, which always comes as the master waits for the response.
    fn unlisted<'a>(
        &self,
        received: &'a [u8],
        is_ours: &impl Fn(u8) -> bool,
    ) -> Option<(usize, u8, &'a [u8])> {
        let (&unit, so_far) = received.split_first()?;
        let tells = pdu::request_length(so_far).is_some() || matches!(so_far, [1..=4 | EXCEPTION_BIT.., ..]);
        if tells || is_ours(unit) {
            return None;
        }
        let longest = received.len().min(FRAME_BYTES_MAX);
        (FRAME_BYTES_MIN..=longest).find_map(|end| frame_of(received, end))
    }

    /// The length of the expected response, if `so_far` can be its beginning.
    fn response_length(&self, unit: u8, so_far: &[u8], is_ours: &impl Fn(u8) -> bool) -> Option<usize> {
        let expected = self.expected.as_ref().filter(|expected| expected.unit == unit && !is_ours(unit))?;
        let ResponseLength::Known(length) = pdu::response_length(&expected.request, so_far) else {
            return None;
        };
        match so_far {
            // A read's response carries its byte count.
            [1..=4 | 23, count, ..] if usize::from(*count) + 2 != length => None,
            _ => Some(length),
        }
    }

    fn judge<'a>(&mut self, unit: u8, pdu: &'a [u8], is_ours: &impl Fn(u8) -> bool) -> Sniffed<'a> {
        let expected = self.expected.take();
        let is_request = is_request(pdu);
        if is_ours(unit) {
            return match is_request {
                true => Sniffed::Request { unit, pdu },
                // Another device has this id, or the master is faulty.
                false => Sniffed::Garbage(LastError::Length),
            };
        }
        let fits = |expected: &Foreign| expected.unit == unit && pdu::fits(&expected.request, pdu).is_ok();
        if expected.as_ref().is_some_and(fits) || !is_request {
            return Sniffed::ForeignResponse;
        }
        // Broadcasts have no response.
        if unit != 0 {
            // Fits: it is a frame's PDU.
            self.expected = Pdu::from_slice(pdu).ok().map(|request| Foreign { unit, request });
        }
        Sniffed::ForeignRequest
    }
}

/// The frame in the first `length` bytes of `received`, if they have arrived with a valid CRC: its length, unit and PDU.
fn frame_of(received: &[u8], length: usize) -> Option<(usize, u8, &[u8])> {
    let (unit, pdu) = rtu::decode(received.get(..length)?).ok()?;
    Some((length, unit, pdu))
}

/// Whether `pdu` can be a request, by function and length.
fn is_request(pdu: &[u8]) -> bool {
    pdu::request_length(pdu).is_none_or(|length| length == pdu.len())
        && pdu.first().is_some_and(|function| (1..EXCEPTION_BIT).contains(function))
}

/// Whether `received` is exactly one frame. Trailing zeros keep a CRC valid, so the length must be plausible too.
fn is_whole(received: &[u8]) -> bool {
    rtu::decode(received).is_ok_and(|(_, pdu)| {
        received.last() != Some(&0) || pdu::request_length(pdu).is_none_or(|length| length == pdu.len())
    })
}

/// Why the bytes between two silences are not a frame.
fn garbage(received: &[u8]) -> LastError {
    match received.len() {
        FRAME_BYTES_MIN..=FRAME_BYTES_MAX => LastError::Checksum,
        _ => LastError::Length,
    }
}
