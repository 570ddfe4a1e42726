//! Which requests the units of all ports may still answer: pure.
//!
//! RTU and ASCII have no transaction numbers. A request that was sent is *outstanding* until it is settled, however long that
//! takes: its response may come late, behind a later request. What is assumed of everything between the gateway and the
//! device, and the device itself, is that responses keep the order of the requests, that none is sent twice, and that
//! broadcasts are not answered. Any response, and any request, may be lost. Then:
//!
//! * A response that fits one outstanding request alone is the response to that one, and settles it with all before it.
//! * A response that fits several is the response to one of them, and nobody knows to which: no requester gets it. Whichever it
//!   is, the first of them and all before it are settled.
//! * A request is sent when no other of its function is outstanding: then its normal and its exception response fit it alone.
//!   Otherwise a *proof* goes first: a request whose normal response fits nothing that was sent before it.
//!
//! What is remembered of a request is the [`Shape`] of its responses. Where a unit has more outstanding than there is room
//! for, the shapes are forgotten, and any response fits until a proof with a number of its own ([`DIAGNOSTIC_PROOF`]) is answered.

use heapless::Vec;

use crate::modbus::Exception;
use crate::modbus::crc::crc16;
use crate::modbus::pdu::function::{
    DIAGNOSTICS, READ_COILS, READ_DISCRETE_INPUTS, READ_HOLDING_REGISTERS, READ_INPUT_REGISTERS,
    READ_WRITE_MULTIPLE_REGISTERS, WRITE_FILE_RECORD,
};
use crate::modbus::pdu::{EXCEPTION_BIT, confirmation};
use crate::settings::PORTS_MAX;

/// Requests that are remembered for one unit.
pub const OF_UNIT_MAX: usize = 8;
/// Requests that are remembered for all units of all ports: few units have any, but for the one that is open.
pub const OUTSTANDING_MAX: usize = if cfg!(feature = "small") { 32 } else { 256 };
/// A request of function 8, sub-function 0, which is answered by its own bytes, without the number that follows.
pub const DIAGNOSTIC_PROOF: [u8; 3] = [DIAGNOSTICS, 0, 0];
/// Unit ids of a port, in words of 32 bits.
const UNIT_WORDS: usize = 8;

/// What the responses to a request look like, as far as they can be told from those to others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    function: u8,
    /// The byte count of a read; the check of the fields that a response repeats; none where the function is all there is.
    key: Option<u16>,
}

impl Shape {
    /// The shape of the normal response to `request`, a PDU. Any of its exceptions has the function alone.
    pub fn of_request(request: &[u8]) -> Self {
        let count = |high: u8, low: u8| u16::from_be_bytes([high, low]);
        let key = match *request {
            [READ_COILS | READ_DISCRETE_INPUTS, _, _, high, low] => Some(count(high, low).div_ceil(8)),
            [READ_HOLDING_REGISTERS | READ_INPUT_REGISTERS, _, _, high, low]
            | [READ_WRITE_MULTIPLE_REGISTERS, _, _, high, low, ..] => Some(count(high, low).wrapping_mul(2)),
            _ => repeated(request),
        };
        Self { function: function(request), key }
    }

    /// The shape of `response`, a PDU.
    fn of_response(response: &[u8]) -> Self {
        let key = match *response {
            [READ_COILS..=READ_INPUT_REGISTERS | READ_WRITE_MULTIPLE_REGISTERS, count, ..] => {
                Some(u16::from(count))
            }
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

/// The check of what requests and responses have in common, which is compared in place of the bytes.
fn repeated(pdu: &[u8]) -> Option<u16> {
    let fields = match pdu {
        [DIAGNOSTICS, 0, 0, ..] | [WRITE_FILE_RECORD, ..] => Some(pdu),
        // The data of other sub-functions are the device's affair.
        [DIAGNOSTICS, _, _, ..] => pdu.get(..3),
        _ => confirmation(pdu),
    };
    fields.map(crc16)
}

/// Why a request was sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// Somebody wants its response.
    Request,
    /// It is a proof by function 8 with a number.
    Diagnostic,
    /// It is a proof by a read.
    Read,
    /// Nobody sent it: a response like this came unsolicited, and more may come.
    Unsolicited,
}

/// One request that may still be answered.
#[derive(Debug, Clone, Copy)]
struct Entry {
    port: u8,
    unit: u8,
    purpose: Purpose,
    shape: Shape,
}

/// Which request a response belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Match {
    /// To the latest one alone, which may be the one whose response is awaited.
    Latest(Purpose),
    /// To an earlier one alone.
    Earlier(Purpose),
    /// To one of several.
    Several,
    /// To none.
    Unsolicited,
}

/// What a response has told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Settled {
    /// Which request it belongs to.
    pub whose: Match,
    /// A proof by function 8 was sent before that request, and has not been answered.
    pub passed_diagnostic: bool,
    /// It answers a proof by function 8, one way or another.
    pub is_diagnostic: bool,
}

/// The outstanding requests of all ports, each unit's in the order in which they were sent.
pub struct Outstanding {
    entries: Vec<Entry, OUTSTANDING_MAX>,
    /// A bit for each unit of which more was outstanding than is remembered.
    forgotten: [[u32; UNIT_WORDS]; PORTS_MAX],
    /// Of the last proof by function 8, if there was one.
    number: Option<u16>,
}

impl Outstanding {
    /// Nothing has been sent.
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

    /// Whether nothing is outstanding but, if `open`, the request whose response is awaited.
    pub fn is_in_step(&self, port: u8, unit: u8, open: bool) -> bool {
        self.of(port, unit).count() <= usize::from(open) && !self.has_forgotten(port, unit)
    }

    /// Whether the normal response of such a `shape` and an exception would fit no other request than that one.
    pub fn is_unique(&self, port: u8, unit: u8, shape: &Shape) -> bool {
        let same_function = |(_, entry): (usize, &Entry)| entry.shape.function == shape.function;
        !self.has_forgotten(port, unit) && !self.of(port, unit).any(same_function)
    }

    /// Whether a normal response of such a `shape` would fit no other request than that one.
    pub fn proves(&self, port: u8, unit: u8, shape: &Shape) -> bool {
        !self.has_forgotten(port, unit) && !self.of(port, unit).any(|(_, entry)| entry.shape.fits(shape))
    }

    /// A proof by function 8, with a number that is not outstanding. `seed` is any number that is another at each start.
    pub fn diagnostic(&mut self, seed: u64) -> [u8; 5] {
        // A generator of all 65536 numbers (the multiplier is 1 more than a multiple of 4, the step is odd).
        let last = self.number.unwrap_or(seed as u16);
        let number = last.wrapping_mul(25_173).wrapping_add(13_849);
        self.number = Some(number);
        let [function, high, low] = DIAGNOSTIC_PROOF;
        let [number_high, number_low] = number.to_be_bytes();
        [function, high, low, number_high, number_low]
    }

    /// A request of this `shape` is sent now.
    pub fn sent(&mut self, port: u8, unit: u8, shape: Shape, purpose: Purpose) {
        self.make_room(port, unit);
        // There is room now.
        let _ = self.entries.push(Entry { port, unit, purpose, shape });
    }

    /// A response like `response` came that nobody has asked for: others may follow.
    fn note_unsolicited(&mut self, port: u8, unit: u8, response: &[u8]) {
        self.make_room(port, unit);
        let at = self.of(port, unit).next().map_or(self.entries.len(), |(at, _)| at);
        let shape = Shape::of_response(response);
        // There is room now.
        let _ = self.entries.insert(at, Entry { port, unit, purpose: Purpose::Unsolicited, shape });
    }

    /// Room for one more of `unit`, if need be at the price of the memory of what is outstanding at a unit.
    fn make_room(&mut self, port: u8, unit: u8) {
        if self.of(port, unit).count() >= OF_UNIT_MAX {
            self.forget(port, unit);
        } else if self.entries.is_full()
            && let Some(&Entry { port, unit, .. }) = self.entries.first()
        {
            self.forget(port, unit);
        }
    }

    /// What is outstanding at `unit` is no longer known: anything may be.
    pub fn forget(&mut self, port: u8, unit: u8) {
        self.settle_all(port, unit);
        if let Some(word) = self.word(port, unit) {
            *word |= 1 << (unit % 32);
        }
    }

    /// Nothing is outstanding at `unit` any more.
    pub fn settle_all(&mut self, port: u8, unit: u8) {
        self.entries.retain(|entry| entry.unit != unit || entry.port != port);
        if let Some(word) = self.word(port, unit) {
            *word &= !(1 << (unit % 32));
        }
    }

    /// Takes the first entries of `unit` out, up to the one at `last`; says whether another proof by function 8 was among them.
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

    /// `unit` has sent `response`, whole and undamaged.
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
        // A number of its own tells it from all that has been forgotten.
        let has_number = is_diagnostic && !is_exception(response);
        if self.has_forgotten(port, unit) && !has_number {
            // It may be the response to the latest one: then what was sent before that will not be answered.
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
        // One that came unsolicited may come again.
        let settled = if entry.purpose == Purpose::Unsolicited { at.checked_sub(1) } else { Some(at) };
        let passed_diagnostic = settled.is_some_and(|last| self.settle(port, unit, last));
        // Whatever was forgotten was sent before.
        if let Some(word) = self.word(port, unit) {
            *word &= !(1 << (unit % 32));
        }
        Settled { whose, passed_diagnostic, is_diagnostic }
    }

    /// The first request of `unit` that `response` fits, if there is one.
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
    /// There are others that it fits.
    several: bool,
    /// Where the latest request of the unit is.
    latest: usize,
}

fn is_exception(response: &[u8]) -> bool {
    response.first().is_some_and(|function| function & EXCEPTION_BIT != 0)
}

impl Default for Outstanding {
    fn default() -> Self {
        Self::new()
    }
}

/// Whether `response` was certainly sent by the device: a gateway between may send these exceptions by itself.
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
