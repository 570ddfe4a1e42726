//! `ping`, and `read` and `write` of a unit's tables: direct requests, which bypass the rules.

use embassy_time::Duration;

use super::probe::harmless;
use super::rows::LINE_VALUES_MAX;
use super::session::Session;
use super::values::Values;
use super::wait::{Begun, Wait, WaitEvent};
use crate::language::listed::joined;
use crate::language::{
    KINDS, ORDERS, ORDERS_EXPECTED, Problem, Word, Words, Wrong, medium, parse_number, small, value_type,
};
use crate::modbus::Exception;
use crate::modbus::pdu::function::{DIAGNOSTICS, WRITE_MULTIPLE_COILS, WRITE_MULTIPLE_REGISTERS};
use crate::modbus::pdu::{EXCEPTION_BIT, check_request};
use crate::scanner::{ByteOrder, Kind, LONG_VALUES, Pdu, Scale, ValueType};
use crate::settings::{PortId, Settings, Time};

const TYPES: &str = if LONG_VALUES {
    "as u16|i16|u32|i32|f32|u64|i64|f64|text N,\n          order 0123|2301|1032|3210"
} else {
    "as u16|i16|u32|i32|f32, order 0123|2301|1032|3210"
};

pub(super) const READ_HELP: &str = joined!(&[
    "read UNIT|POINT ...\treads at once, and shows the values
read POINT
read UNIT coil|discrete|input|holding ADDRESS [OPTION]... via PORT
  OPTION: count N, ",
    TYPES,
]);

pub(super) const WRITE_HELP: &str = joined!(&[
    "write UNIT|POINT ...\twrites at once
write POINT [[at N] VALUE...]\tsets its values, from value N on; between
\tbegin and finish they are only set
write UNIT coil|holding ADDRESS [OPTION]... VALUE... via PORT
  OPTION: ",
    TYPES,
]);

/// Function, address and count; a write's byte count follows (Application Protocol 6).
const READ_BYTES: usize = 5;
const WRITE_HEAD_BYTES: usize = READ_BYTES + 1;

/// The request to send.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ask {
    Ping,
    Read,
    Write,
}

/// The request, and how to decode its response.
pub(super) struct Question {
    pub(super) ask: Ask,
    pub(super) unit: u8,
    kind: Kind,
    pub(super) first: u16,
    pub(super) count: u16,
    pub(super) value: ValueType,
    pub(super) order: ByteOrder,
    /// Values shown so far.
    shown: usize,
}

impl Session<'_, '_> {
    /// Parses and sends the request.
    pub(super) fn ask(&mut self, ask: Ask, words: &Words<'_>) -> Begun<Question> {
        let (question, port) =
            self.gateway.settings(|settings| parse(settings, ask, words, &mut self.pdu))?;
        if let Err(error) = self.take_turn(port) {
            return Ok((None, self.fail(&error)));
        }
        self.unit = question.unit;
        Ok((Some(question), Wait::Response { typed_ends: false }))
    }
}

impl Question {
    /// Shows the outcome, then the remaining values.
    pub(super) fn step(&mut self, session: &mut Session<'_, '_>, event: WaitEvent) -> Wait {
        let unit = self.unit;
        match event {
            WaitEvent::Response(Err(error)) => return session.fail(&error),
            WaitEvent::Response(Ok(took)) => {
                let took = Time(Duration::from_micros(took.as_micros()));
                match *session.pdu {
                    [function, code] if function & EXCEPTION_BIT != 0 => {
                        session.out.line(format_args!("unit {unit}: {} after {took}", Exception(code)));
                        return Wait::End;
                    }
                    _ if self.ask == Ask::Read => {}
                    _ => {
                        session.out.line(format_args!("unit {unit}: response after {took}"));
                        return Wait::End;
                    }
                }
                self.value.form().turn(self.order, session.pdu.get_mut(2..).unwrap_or_default());
            }
            _ => {}
        }
        self.values(session)
    }

    fn values(&mut self, session: &mut Session<'_, '_>) -> Wait {
        let at = self.shown;
        let range = at..(at + LINE_VALUES_MAX).min(self.count.into());
        if range.is_empty() {
            return Wait::End;
        }
        self.shown = range.end;
        let address = usize::from(self.first) + at * usize::from(self.value.registers());
        let cells = session.pdu.get(2..).unwrap_or_default();
        let values = Values { value: self.value, scale: Scale::NONE, cells, range };
        session.out.line(format_args!("[{address}]{values}"));
        Wait::Sent
    }
}

/// Parses the words after `ping`, `read` or `write` into `request`, and returns the port.
pub(super) fn parse(
    settings: &Settings,
    ask: Ask,
    words: &Words,
    request: &mut Pdu,
) -> Result<(Question, PortId), Wrong> {
    let mut question = Question {
        ask,
        unit: small(words.take(), "a unit", 0..=u8::MAX)?,
        kind: Kind::Holding,
        first: 0,
        count: 1,
        value: ValueType::U16,
        order: ByteOrder::default(),
        shown: 0,
    };
    request.clear();
    if ask == Ask::Ping {
        // The device echoes it (Application Protocol 6.8).
        let _ = request.extend_from_slice(harmless(DIAGNOSTICS));
    } else {
        question.table(words, request)?;
    }
    let word = words.take();
    if !word.is("via") {
        return Err(word.expected("via and a port"));
    }
    let word = words.take();
    let port = settings.find(word.text).ok_or_else(|| word.error(Problem::NoSuchPort))?;
    words.end()?;
    Ok((question, port))
}

impl Question {
    /// `holding 100 count 2 as f32`, or `holding 100 as f32 1.5 2`
    fn table(&mut self, words: &Words, request: &mut Pdu) -> Result<(), Wrong> {
        self.kind = words.take().keyword(KINDS, "coil, discrete, input or holding")?;
        self.first = medium(words.take(), "an address", 0..=u16::MAX)?;
        if self.kind.is_bits() {
            self.value = ValueType::Bit;
        }
        let writes = self.ask == Ask::Write;
        // The header is filled in once the number of values is known.
        let head = if writes { WRITE_HEAD_BYTES } else { READ_BYTES };
        let _ = request.resize(head, 0);
        let mut values = 0;
        while !words.peek().is("via") && !words.peek().is_end() {
            let word = if self.value.is_text() { words.take_quoted() } else { words.take() };
            if word.is("as") && !self.kind.is_bits() {
                self.value = value_type(words, true)?;
            } else if word.is("order") {
                self.order = words.take().keyword(ORDERS, ORDERS_EXPECTED)?;
            } else if word.is("count") && !writes {
                let word = words.take();
                let count = parse_number(word.text).and_then(|count| u16::try_from(count).ok());
                self.count = count.ok_or_else(|| word.expected("how many values"))?;
            } else if writes {
                self.append(request, values, word)?;
                values += 1;
            } else {
                return Err(word.expected("count, as, order or via"));
            }
        }
        if writes {
            self.count = values;
        }
        self.fill_in(request, head).ok_or_else(|| words.peek().expected("what a frame can hold"))
    }

    /// Appends value number `at` of a write.
    fn append(&self, request: &mut Pdu, at: u16, word: Word<'_>) -> Result<(), Wrong> {
        if !self.kind.is_writable() {
            return Err(word.expected("coil or holding: the others cannot be written"));
        }
        let has_room = if self.kind.is_bits() {
            let bit = parse_number(word.text).filter(|bit| *bit <= u8::MAX.into());
            let bit = u8::from(bit.ok_or_else(|| word.expected("0 or 1"))? != 0) << (at % 8);
            match request.last_mut() {
                Some(byte) if !at.is_multiple_of(8) => {
                    *byte |= bit;
                    true
                }
                _ => request.push(bit).is_ok(),
            }
        } else {
            let value = self.value.parse(word.text);
            let mut value = value.ok_or_else(|| word.expected("a value of this type"))?;
            let value = value.get_mut(..2 * usize::from(self.value.registers())).unwrap_or_default();
            self.value.form().turn(self.order, value);
            request.extend_from_slice(value).is_ok()
        };
        has_room.then_some(()).ok_or_else(|| word.expected("no more values than a frame holds"))
    }

    /// Fills in the header of a `request`; `None` if it does not fit one frame.
    fn fill_in(&self, request: &mut Pdu, head: usize) -> Option<()> {
        let cells = self.count.checked_mul(self.value.registers())?;
        let function = match self.kind {
            kind if self.ask == Ask::Read => kind.read_function(),
            Kind::Coil => WRITE_MULTIPLE_COILS,
            _ => WRITE_MULTIPLE_REGISTERS,
        };
        let ([first, first_low], [count, count_low]) = (self.first.to_be_bytes(), cells.to_be_bytes());
        let bytes = (request.len() - head) as u8;
        let fields = [function, first, first_low, count, count_low, bytes];
        request.iter_mut().zip(fields).take(head).for_each(|(place, field)| *place = field);
        check_request(request).ok()
    }
}
