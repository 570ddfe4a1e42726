//! `ping`, and `read` and `write` of a unit's tables: what is asked at once, past the rules.

use embassy_time::Duration;
use embedded_io_async::{Read, Write};

use super::command::Session;
use super::probe::request;
use super::rows::{LINE_VALUES_MAX, Values};
use crate::config::{
    KINDS, ORDERS, PortId, Problem, Settings, TYPES, Time, Word, Words, Wrong, parse_number,
};
use crate::hal::{Store, System};
use crate::modbus::Exception;
use crate::modbus::pdu::function::{DIAGNOSTICS, WRITE_MULTIPLE_COILS, WRITE_MULTIPLE_REGISTERS};
use crate::modbus::pdu::{EXCEPTION_BIT, check_request};
use crate::scanner::{ByteOrder, Kind, Pdu, ValueType};

/// What is asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ask {
    Ping,
    Read,
    Write,
}

/// A request, and how its answer is to be read.
struct Question {
    unit: u8,
    port: PortId,
    request: Pdu,
    kind: Kind,
    first: u16,
    count: u16,
    value: ValueType,
    order: ByteOrder,
}

impl<IO: Read + Write, S: Store, Y: System> Session<'_, '_, IO, S, Y> {
    /// Asks what the words say, and shows what came of it.
    pub(super) async fn ask(&mut self, ask: Ask, words: &Words<'_>) -> Result<(), IO::Error> {
        let question = match self.gateway.settings(|settings| parse(settings, ask, words)) {
            Ok(question) => question,
            Err(Wrong) => return self.fail(format_args!("{}", words.wrong())).await,
        };
        let mut answer = Pdu::new();
        let asked = match self.gateway.turn(question.port) {
            Ok(turn) => turn.ask(question.unit, &question.request, &mut answer).await,
            Err(error) => Err(error),
        };
        let took = match asked {
            Ok(took) => took,
            Err(error) => return self.fail(format_args!("{error}")).await,
        };
        let (unit, took) = (question.unit, Time(Duration::from_micros(took.as_micros())));
        match *answer {
            [function, code] if function & EXCEPTION_BIT != 0 => {
                self.out.line(format_args!("unit {unit}: {} after {took}", Exception(code))).await
            }
            _ if ask == Ask::Read => self.values(&question, &answer).await,
            _ => self.out.line(format_args!("unit {unit}: answer after {took}")).await,
        }
    }

    async fn values(&mut self, question: &Question, answer: &[u8]) -> Result<(), IO::Error> {
        let mut data = Pdu::from_slice(answer.get(2..).unwrap_or(&[])).unwrap_or_default();
        if question.value.registers() == 2 {
            question.order.turn(&mut data);
        }
        let mut at = 0;
        while at < usize::from(question.count) {
            let range = at..(at + LINE_VALUES_MAX).min(question.count.into());
            let step = if question.kind.is_bits() { 1 } else { usize::from(question.value.registers()) };
            let address = usize::from(question.first) + at * step;
            at = range.end;
            let values = Values { kind: question.kind, value: question.value, cells: &data, range };
            self.out.line(format_args!("[{address}]{values}")).await?;
        }
        Ok(())
    }
}

/// Reads the words behind `ping`, `read` or `write`.
fn parse(settings: &Settings, ask: Ask, words: &Words) -> Result<Question, Wrong> {
    let unit = number(words.take(), "a unit from 0 to 255")?;
    let mut question = Question {
        unit,
        port: PortId(0),
        // The device gives it back (Application Protocol 6.8).
        request: Pdu::from_slice(&request(DIAGNOSTICS)).unwrap_or_default(),
        kind: Kind::Holding,
        first: 0,
        count: 1,
        value: ValueType::U16,
        order: ByteOrder::default(),
    };
    if ask != Ask::Ping {
        question.table(ask, words)?;
    }
    let word = words.take();
    if !word.is("via") {
        return Err(word.expected("via and a port"));
    }
    let word = words.take();
    question.port = settings.find(word.text).ok_or_else(|| word.error(Problem::NoSuchPort))?;
    words.end()?;
    Ok(question)
}

impl Question {
    /// `holding 100 count 2 as f32`, or `holding 100 as f32 1.5 2`
    fn table(&mut self, ask: Ask, words: &Words) -> Result<(), Wrong> {
        self.kind = words.take().keyword(KINDS, "coil, discrete, input or holding")?;
        self.first = number(words.take(), "an address from 0 to 65535")?;
        let mut data = Pdu::new();
        let mut values = 0;
        while !words.peek().is("via") && !words.peek().is_end() {
            let word = words.take();
            if word.is("as") && !self.kind.is_bits() {
                self.value = words.take().keyword(TYPES, "u16, i16, u32, i32 or f32")?;
            } else if word.is("order") {
                self.order = words.take().keyword(ORDERS, "0123, 2301, 1032 or 3210")?;
            } else if ask == Ask::Read && word.is("count") {
                self.count = number(words.take(), "how many values")?;
            } else if ask == Ask::Write {
                self.append(&mut data, values, word)?;
                values += 1;
            } else {
                return Err(word.expected("count, as, order or via"));
            }
        }
        let end = words.peek();
        if ask == Ask::Write {
            self.count = values;
        }
        self.request = self.request(ask, &data).ok_or_else(|| end.expected("what a frame can hold"))?;
        Ok(())
    }

    /// Appends value number `at` of a write.
    fn append(&self, data: &mut Pdu, at: u16, word: Word<'_>) -> Result<(), Wrong> {
        if !self.kind.is_writable() {
            return Err(word.expected("coil or holding: the others cannot be written"));
        }
        let full = |_| word.expected("no more values than a frame holds");
        if self.kind.is_bits() {
            let bit: u8 = number(word, "0 or 1")?;
            if at.is_multiple_of(8) {
                data.push(0).map_err(full)?;
            }
            if let Some(byte) = data.last_mut() {
                *byte |= u8::from(bit != 0) << (at % 8);
            }
            return Ok(());
        }
        let mut value = self.value.parse(word.text).ok_or_else(|| word.expected("a value of this type"))?;
        let bytes = 2 * usize::from(self.value.registers());
        if bytes == 4 {
            self.order.turn(&mut value);
        }
        data.extend_from_slice(value.get(..bytes).unwrap_or(&[])).map_err(|_| full(0))
    }

    /// The request for it, if one frame will do.
    fn request(&self, ask: Ask, data: &[u8]) -> Option<Pdu> {
        let each = if self.kind.is_bits() { 1 } else { self.value.registers() };
        let cells = self.count.checked_mul(each)?;
        let (write_function, read_function) = match self.kind {
            Kind::Coil => (WRITE_MULTIPLE_COILS, self.kind.read_function()),
            kind => (WRITE_MULTIPLE_REGISTERS, kind.read_function()),
        };
        let function = if ask == Ask::Write { write_function } else { read_function };
        let mut request = Pdu::from_slice(&[function]).ok()?;
        request.extend_from_slice(&self.first.to_be_bytes()).ok()?;
        request.extend_from_slice(&cells.to_be_bytes()).ok()?;
        if ask == Ask::Write {
            request.push(data.len() as u8).ok()?;
            request.extend_from_slice(data).ok()?;
        }
        check_request(&request).ok().map(|()| request)
    }
}

fn number<T: TryFrom<u32>>(word: Word<'_>, expected: &'static str) -> Result<T, Wrong> {
    parse_number(word.text).and_then(|number| T::try_from(number).ok()).ok_or_else(|| word.expected(expected))
}
