//! Outstanding requests: which earlier requests the units of all ports may still respond to. Pure.
//!
//! RTU and ASCII have no transaction ids. A request that was sent is *outstanding* until it is settled, however long that takes:
//! its response may arrive late, after a later request. The only assumptions about the device and everything in between are that
//! responses keep the order of the requests, that none is sent twice, and that broadcasts get no response. Any response, and any
//! request, may be lost. Then:
//!
//! * A response that fits only one outstanding request belongs to it, and settles it and all before it.
//! * A response that fits several belongs to one of them, but it is unknown which: no requester gets it. Whichever it is, the
//!   first of them and all before it are settled.
//! * A request is sent when no other of its function is outstanding: then its normal and its exception response fit it alone.
//!   Otherwise a *proof* goes first: a request whose normal response fits nothing sent before it.
//!
//! What is stored of a request is the [`Shape`] of its responses. When a unit has more outstanding requests than there is room
//! for, their shapes are forgotten, and any response may belong to them until a proof with a unique number ([`DIAGNOSTIC_PROOF`])
//! is answered.

use heapless::Vec;

use crate::modbus::Exception;
use crate::modbus::crc::crc16;
use crate::modbus::pdu::function::{DIAGNOSTICS, Form};
use crate::modbus::pdu::{EXCEPTION_BIT, confirmation};
use crate::settings::PORTS_MAX;

/// Requests stored for one unit.
pub const OF_UNIT_MAX: usize = 8;
/// Requests stored for all units of all ports: few units have more than the one in flight.
pub const OUTSTANDING_MAX: usize = if cfg!(feature = "small") { 32 } else { 256 };
/// A request of function 8, sub-function 0, which the unit repeats as its response; the number that follows is left out.
pub const DIAGNOSTIC_PROOF: [u8; 3] = [DIAGNOSTICS, 0, 0];
/// The unit ids of a port, as a bit map of 32-bit words.
const UNIT_WORDS: usize = 8;

/// The properties of responses to a request, as far as they distinguish them from others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    function: u8,
    /// The byte count of a read, or a checksum of the fields that the response repeats; `None` if only the function is known.
    key: Option<u16>,
}

impl Shape {
    /// The shape of the normal response to `request`, a PDU. Its exceptions share only the function.
    pub fn of_request(request: &[u8]) -> Self {
        let key = match (Form::of(request), request) {
            (Some(Form::Read(cells)), &[_, _, _, high, low])
            | (Some(Form::ReadWrite { read: cells, .. }), &[_, _, _, high, low, ..]) => {
                // A valid request asks for no more than one byte can count.
                Some(cells.bytes(u16::from_be_bytes([high, low])) as u16)
            }
            _ => repeated(request),
        };
        Self { function: function(request), key }
    }

    /// The shape of `response`, a PDU.
    fn of_response(response: &[u8]) -> Self {
        let key = match (Form::of(response), response) {
            (Some(Form::Read(_) | Form::ReadWrite { .. }), &[_, count, ..]) => Some(u16::from(count)),
            _ => repeated(response),
        };
        Self { function: function(response), key }
    }

    fn fits(&self, other: &Self) -> bool {
        let keys = self.key.zip(other.key);
        self.function == other.function && keys.is_none_or(|(own, other)| own == other)
    }
}

/// The function of a request, a response or an exception.
fn function(pdu: &[u8]) -> u8 {
    pdu.first().map_or(0, |function| function & !EXCEPTION_BIT)
}

/// A checksum of the fields that request and response have in common, compared instead of the bytes.
fn repeated(pdu: &[u8]) -> Option<u16> {
    let fields = match (Form::of(pdu), pdu) {
        (Some(Form::Diagnostics), [_, 0, 0, ..]) | (Some(Form::WriteFile), _) => Some(pdu),
        // Other sub-functions have device-specific data.
        (Some(Form::Diagnostics), [_, _, _, ..]) => pdu.get(..3),
        _ => confirmation(pdu),
    };
    fields.map(crc16)
}

/// Why a request was sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// A requester wants its response.
    Request,
    /// A proof by function 8 with a number.
    Diagnostic,
    /// A proof by a read.
    Read,
    /// Not sent: a response like this arrived unsolicited, and more may follow.
    Unsolicited,
}

/// A request that may still be answered.
#[derive(Debug, Clone, Copy)]
struct Entry {
    port: u8,
    unit: u8,
    purpose: Purpose,
    shape: Shape,
}

/// The request that a response belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Match {
    /// Only the latest one, whose response may be the expected one.
    Latest(Purpose),
    /// Only an earlier one.
    Earlier(Purpose),
    /// One of several.
    Several,
    /// None.
    Unsolicited,
}

/// The result of matching a response.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Settled {
    /// The request it belongs to.
    pub whose: Match,
    /// A proof by function 8 was sent before that request and has not been answered.
    pub passed_diagnostic: bool,
    /// It answers a proof by function 8, normally or with an exception.
    pub is_diagnostic: bool,
}

/// The outstanding requests of all ports, each unit's in order of sending.
pub struct Outstanding {
    entries: Vec<Entry, OUTSTANDING_MAX>,
    /// A bit for each unit with more outstanding requests than could be stored.
    forgotten: [[u32; UNIT_WORDS]; PORTS_MAX],
    /// Number of the last proof by function 8, if any.
    number: Option<u16>,
}

impl Outstanding {
    /// Without outstanding requests.
    pub const fn new() -> Self {
        Self { entries: Vec::new(), forgotten: [[0; UNIT_WORDS]; PORTS_MAX], number: None }
    }

    fn of(&self, port: u8, unit: u8) -> impl DoubleEndedIterator<Item = (usize, &Entry)> {
        let entries = self.entries.iter().enumerate();
        entries.filter(move |(_, entry)| entry.unit == unit && entry.port == port)
    }

    fn word(&mut self, port: u8, unit: u8) -> Option<&mut u32> {
        self.forgotten.get_mut(usize::from(port))?.get_mut(usize::from(unit / 32))
    }

    fn has_forgotten(&self, port: u8, unit: u8) -> bool {
        let words = self.forgotten.get(usize::from(port));
        let word = words.and_then(|words| words.get(usize::from(unit / 32)));
        word.is_some_and(|word| word >> (unit % 32) & 1 == 1)
    }

    /// Whether nothing is outstanding except, with `open`, the request whose response is expected.
    pub fn is_in_step(&self, port: u8, unit: u8, open: bool) -> bool {
        self.of(port, unit).count() <= usize::from(open) && !self.has_forgotten(port, unit)
    }

    /// Whether the normal response of `shape` and an exception would fit no other request.
    pub fn is_unique(&self, port: u8, unit: u8, shape: &Shape) -> bool {
        let same_function = |(_, entry): (usize, &Entry)| entry.shape.function == shape.function;
        !self.has_forgotten(port, unit) && !self.of(port, unit).any(same_function)
    }

    /// Whether a normal response of `shape` would fit no other request.
    pub fn proves(&self, port: u8, unit: u8, shape: &Shape) -> bool {
        !self.has_forgotten(port, unit) && !self.of(port, unit).any(|(_, entry)| entry.shape.fits(shape))
    }

    /// A proof by function 8 with a number that is not outstanding. `seed` should differ at each start.
    pub fn diagnostic(&mut self, seed: u64) -> [u8; 5] {
        // A full-period generator over 16 bits (multiplier 1 modulo 4, odd increment).
        let last = self.number.unwrap_or(seed as u16);
        let number = last.wrapping_mul(25_173).wrapping_add(13_849);
        self.number = Some(number);
        let [function, high, low] = DIAGNOSTIC_PROOF;
        let [number_high, number_low] = number.to_be_bytes();
        [function, high, low, number_high, number_low]
    }

    /// Records that a request of this `shape` is being sent.
    pub fn sent(&mut self, port: u8, unit: u8, shape: Shape, purpose: Purpose) {
        self.make_room(port, unit);
        // Room was made above.
        let _ = self.entries.push(Entry { port, unit, purpose, shape });
    }

    /// Records an unsolicited `response`; others like it may follow.
    fn note_unsolicited(&mut self, port: u8, unit: u8, response: &[u8]) {
        self.make_room(port, unit);
        let at = self.of(port, unit).next().map_or(self.entries.len(), |(at, _)| at);
        let shape = Shape::of_response(response);
        // Room was made above.
        let _ = self.entries.insert(at, Entry { port, unit, purpose: Purpose::Unsolicited, shape });
    }

    /// Makes room for one more request of `unit`, forgetting the shapes of some unit's requests if necessary.
    fn make_room(&mut self, port: u8, unit: u8) {
        if self.of(port, unit).count() >= OF_UNIT_MAX {
            self.forget(port, unit);
        } else if self.entries.is_full()
            && let Some(&Entry { port, unit, .. }) = self.entries.first()
        {
            self.forget(port, unit);
        }
    }

    /// Forgets the shapes of requests outstanding at `unit`: they may be anything.
    pub fn forget(&mut self, port: u8, unit: u8) {
        self.settle_all(port, unit);
        if let Some(word) = self.word(port, unit) {
            *word |= 1 << (unit % 32);
        }
    }

    /// Settles everything outstanding at `unit`.
    pub fn settle_all(&mut self, port: u8, unit: u8) {
        self.entries.retain(|entry| entry.unit != unit || entry.port != port);
        if let Some(word) = self.word(port, unit) {
            *word &= !(1 << (unit % 32));
        }
    }

    /// Removes the first entries of `unit`, up to `last`; returns whether another proof by function 8 was among them.
    fn settle(&mut self, port: u8, unit: u8, last: usize) -> bool {
        let (mut at, mut diagnostics) = (0, false);
        self.entries.retain(|entry| {
            let settled = at <= last && entry.unit == unit && entry.port == port;
            diagnostics |= settled && at < last && entry.purpose == Purpose::Diagnostic;
            at += 1;
            !settled
        });
        diagnostics
    }

    /// Matches a valid `response` from `unit`.
    pub fn match_response(&mut self, port: u8, unit: u8, response: &[u8]) -> Settled {
        let Some(Fitting { at, entry, several, latest }) = self.fitting(port, unit, response) else {
            let forgotten = self.has_forgotten(port, unit);
            if !forgotten {
                self.note_unsolicited(port, unit, response);
            }
            let whose = if forgotten { Match::Several } else { Match::Unsolicited };
            return Settled { whose, passed_diagnostic: false, is_diagnostic: false };
        };
        let is_diagnostic = entry.purpose == Purpose::Diagnostic;
        // Its number distinguishes it from everything that has been forgotten.
        let has_number = is_diagnostic && !is_exception(response);
        if self.has_forgotten(port, unit) && !has_number {
            // If it belongs to the latest request, earlier ones will not be answered any more.
            let mut before = self.of(port, unit).rev().skip(1);
            let passed_diagnostic = before.any(|(_, entry)| entry.purpose == Purpose::Diagnostic);
            return Settled { whose: Match::Several, passed_diagnostic, is_diagnostic };
        }
        let whose = match () {
            () if several || entry.purpose == Purpose::Unsolicited => Match::Several,
            () if at == latest => Match::Latest(entry.purpose),
            () => Match::Earlier(entry.purpose),
        };
        if !is_proof(response) {
            return Settled { whose, passed_diagnostic: false, is_diagnostic };
        }
        // An unsolicited response may be repeated.
        let settled = if entry.purpose == Purpose::Unsolicited { at.checked_sub(1) } else { Some(at) };
        let passed_diagnostic = settled.is_some_and(|last| self.settle(port, unit, last));
        // Everything forgotten was sent earlier.
        if let Some(word) = self.word(port, unit) {
            *word &= !(1 << (unit % 32));
        }
        Settled { whose, passed_diagnostic, is_diagnostic }
    }

    /// The first request of `unit` that `response` fits, if any.
    fn fitting(&self, port: u8, unit: u8, response: &[u8]) -> Option<Fitting> {
        let (shape, exception) = (Shape::of_response(response), is_exception(response));
        let mut fitting = self.of(port, unit).filter(|(_, entry)| match exception {
            true => entry.shape.function == shape.function,
            false => entry.shape.fits(&shape),
        });
        let (at, entry) = fitting.next()?;
        let several = fitting.next().is_some();
        let (latest, _) = self.of(port, unit).next_back()?;
        Some(Fitting { at, entry: *entry, several, latest })
    }
}

/// The first request that a response fits.
struct Fitting {
    at: usize,
    entry: Entry,
    /// Whether it fits others too.
    several: bool,
    /// Index of the unit's latest request.
    latest: usize,
}

fn is_exception(response: &[u8]) -> bool {
    response.first().is_some_and(|function| function & EXCEPTION_BIT != 0)
}

/// Whether `response` certainly comes from the device: an intermediate gateway may generate these exceptions.
fn is_proof(response: &[u8]) -> bool {
    match *response {
        [function, code] if function & EXCEPTION_BIT != 0 => !matches!(
            Exception(code),
            Exception::ACKNOWLEDGE
                | Exception::BUSY
                | Exception::GATEWAY_NO_PATH
                | Exception::GATEWAY_NO_RESPONSE
        ),
        _ => true,
    }
}
