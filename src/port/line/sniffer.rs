//! What a frame is that was heard on a serial line with other devices: a request for us, a request for another one, another
//! one's response, or garbage. Pure, with silences as facts.
//!
//! In RTU a frame of another unit has two readings: the response to a read begins as a request does. So after another unit's
//! request its response is expected, and is taken for that if it fits; everything else is read as a request. A frame under
//! one of our ids is never somebody's response, whatever was expected.
//!
//! Silence tells frames apart, and all that stands between two silences is tried as one frame first. Where silences cannot
//! be seen (reads of an operating system are late), or were too short, frames are split off by the lengths that both
//! readings give them, with good CRCs; never does a frame begin anywhere but at the end of another one. Who has lost the
//! thread, as everybody has who is switched on, waits for a silence. ASCII frames need none of that: they have their
//! beginnings and ends in them.

use crate::modbus::Pdu;
use crate::modbus::pdu::{self, EXCEPTION_BIT, End, ResponseLength};
use crate::modbus::rtu::{self, FRAME_BYTES_MAX, FRAME_BYTES_MIN};
use crate::stats::LastError;

mod ascii;

pub use ascii::AsciiSniffer;

/// What was heard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sniffed<'a> {
    /// A request for one of our units, or for everybody.
    Request {
        /// The unit as the master calls it.
        unit: u8,
        /// Function code and data.
        pdu: &'a [u8],
    },
    /// A request for another unit.
    ForeignRequest,
    /// The response of another unit.
    ForeignResponse,
    /// No frame, and why.
    Garbage(LastError),
    /// Nothing that could be judged yet.
    Nothing,
}

/// Listens on an RTU line.
pub struct RtuSniffer {
    expected: Option<Foreign>,
    /// Whether the beginning of what is heard is the beginning of a frame.
    in_step: bool,
}

/// A request for another unit, whose answer is expected.
struct Foreign {
    unit: u8,
    request: Pdu,
}

impl Default for RtuSniffer {
    fn default() -> Self {
        Self::new()
    }
}

impl RtuSniffer {
    /// Switched on in the middle of whatever happens on the line.
    pub const fn new() -> Self {
        Self { expected: None, in_step: false }
    }

    /// Whether only a silence helps, though nothing was heard.
    pub const fn needs_silence(&self) -> bool {
        !self.in_step
    }

    /// Judges the beginning of `received`, all that was heard and not yet judged, and says how many bytes of it that took.
    /// `silent`: the line has been silent since. `is_ours` knows our units, 0 among them if broadcasts are for us.
    ///
    /// To be called again with the rest until there is [`Heard::Nothing`].
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
                // It may be data that looks like a frame: the master will ask again.
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
            // Longer than any frame, and none at its beginning: the thread is lost.
            self.in_step = false;
            self.expected = None;
            return (Sniffed::Garbage(LastError::Length), 1);
        }
        (Sniffed::Nothing, 0)
    }

    /// How many bytes the frame will have at least that `received`, all that was heard and not yet judged, is the beginning of.
    /// None when that is no more than is there, or nothing is known of it.
    pub fn at_least(&self, received: &[u8], is_ours: impl Fn(u8) -> bool) -> Option<usize> {
        let (&unit, so_far) = received.split_first().filter(|_| self.in_step)?;
        let request = match pdu::request_end(so_far) {
            End::At(length) => Some(length),
            End::Later | End::Unknown => None,
        };
        // The response to a request that was not heard.
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
        // As long as it is here it is none that would have come to its end.
        bytes.into_iter().filter(|bytes| *bytes > received.len()).min()
    }

    /// The first frame by one of its readings, when that much is there with a good CRC.
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
                // The response that is expected may still become whole, and its data could look like a request.
                true if !silent => return None,
                _ => {
                    if let Some(frame) = whole(length) {
                        return Some(frame);
                    }
                }
            }
        }
        let as_request = pdu::request_length(so_far).and_then(whole);
        // The response to a request that was not heard: a read's says how long it is.
        let unknown = || match so_far {
            [1..=4, count, ..] if !is_ours(unit) => whole(2 + usize::from(*count)),
            [function, _, ..] if function & EXCEPTION_BIT != 0 => whole(2),
            _ => None,
        };
        as_request.or_else(unknown).or_else(|| self.unlisted(received, is_ours))
    }

    /// A frame of another unit whose function does not tell its length: it ends where the CRC is good. For a frame of
    /// ours the silence is awaited: it comes, since the master waits for us.
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

    /// The length of the response that is expected, if `so_far` can be the beginning of that.
    fn response_length(&self, unit: u8, so_far: &[u8], is_ours: &impl Fn(u8) -> bool) -> Option<usize> {
        let expected = self.expected.as_ref().filter(|expected| expected.unit == unit && !is_ours(unit))?;
        let ResponseLength::Known(length) = pdu::response_length(&expected.request, so_far) else {
            return None;
        };
        match so_far {
            // A read's response counts its bytes.
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
                // Another device has this id, or the master is wrong.
                false => Sniffed::Garbage(LastError::Length),
            };
        }
        let fits = |expected: &Foreign| expected.unit == unit && pdu::fits(&expected.request, pdu).is_ok();
        if expected.as_ref().is_some_and(fits) || !is_request {
            return Sniffed::ForeignResponse;
        }
        // Nobody answers a broadcast.
        if unit != 0 {
            // A frame's PDU fits.
            self.expected = Pdu::from_slice(pdu).ok().map(|request| Foreign { unit, request });
        }
        Sniffed::ForeignRequest
    }
}

/// The frame that the first `length` bytes of `received` are, if they are there with a good CRC: its length, unit and PDU.
fn frame_of(received: &[u8], length: usize) -> Option<(usize, u8, &[u8])> {
    let (unit, pdu) = rtu::decode(received.get(..length)?).ok()?;
    Some((length, unit, pdu))
}

/// Whether `pdu` can be a request, as far as its function and length go.
fn is_request(pdu: &[u8]) -> bool {
    pdu::request_length(pdu).is_none_or(|length| length == pdu.len())
        && pdu.first().is_some_and(|function| (1..EXCEPTION_BIT).contains(function))
}

/// Whether all of `received` is one frame. A CRC is good with zeros behind it as well, so the length must be possible, too.
fn is_whole(received: &[u8]) -> bool {
    rtu::decode(received).is_ok_and(|(_, pdu)| {
        received.last() != Some(&0) || pdu::request_length(pdu).is_none_or(|length| length == pdu.len())
    })
}

/// What is wrong with bytes between two silences that are no frame.
fn garbage(received: &[u8]) -> LastError {
    match received.len() {
        FRAME_BYTES_MIN..=FRAME_BYTES_MAX => LastError::Checksum,
        _ => LastError::Length,
    }
}
