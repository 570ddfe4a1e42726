//! `explain`: what the rules do with a request, and which one decides. Nothing is sent.

use core::fmt;

use super::run::{Run, command};
use super::session::Session;
use super::wait::Wait;
use crate::language::{Offer, Verb, Words, Wrong, client_role, medium, small};
use crate::modbus::pdu::function::{
    ENCAPSULATED_INTERFACE, MASK_WRITE_REGISTER, MEI_DEVICE_IDENTIFICATION, READ_COILS, READ_FIFO_QUEUE,
    READ_INPUT_REGISTERS, READ_WRITE_MULTIPLE_REGISTERS, WRITE_MULTIPLE_COILS, WRITE_MULTIPLE_REGISTERS,
    WRITE_SINGLE_COIL, WRITE_SINGLE_REGISTER,
};
use crate::routing::{self, Client, Decision};
use crate::scanner::Pdu;
use crate::settings::{ClientRole, PortId, Role, Settings, Special, TLS, canonical};

pub(super) const COMMAND: (&str, Verb<Run>) = (
    "explain",
    command(
        Role::Viewer,
        "explain PORT UNIT FUNCTION\twhat the rules do with a request, and which
explain PORT UNIT FUNCTION [ADDRESS [COUNT]] [from IP] [role ROLE]
  PORT is where it comes; ROLE is that of the client's certificate.
  Nothing is sent.
  explain P502 5 3 100 2 from 192.168.1.7",
        |session, words, _| {
            let Session { gateway, out, .. } = session;
            gateway.settings(|settings| {
                let explained = Explained::parse(settings, words)?;
                out.line(format_args!("{}", explained.text(settings)));
                Ok(Wait::End)
            })
        },
    )
    .then(&[Offer::Ports], &[]),
);

/// The decision about a request.
pub(crate) struct Explained {
    /// The index of the rule that decides, if one does.
    pub(crate) rule: Option<usize>,
    /// Rules match, but require another role.
    lacks_role: bool,
    pub(crate) decision: Decision,
}

impl Explained {
    /// Parses `P502 5 3 100 2 from 192.168.1.7`: port, unit, function, address, count.
    pub(super) fn parse(settings: &Settings, words: &Words<'_>) -> Result<Self, Wrong> {
        let word = words.take();
        let source = settings.find(word.text);
        let source = source.ok_or_else(|| word.expected("the port where the request comes"))?;
        let unit = small(words.take(), "a unit", 0..=u8::MAX)?;
        let function = small(words.take(), "a function", 1..=127)?;
        let (mut address, mut count) = (0, 1);
        if words.peek().begins_with_digit() {
            address = medium(words.take(), "an address", 0..=u16::MAX)?;
        }
        if words.peek().begins_with_digit() {
            count = medium(words.take(), "how many", 1..=2_000)?;
        }
        let mut peer = None;
        if words.peek().is("from") {
            words.take();
            let word = words.take();
            let address = word.text.parse().map(canonical);
            peer = Some(address.map_err(|_| word.expected("an IP address"))?);
        }
        let mut role = ClientRole::NONE;
        if TLS && words.peek().is("role") {
            words.take();
            role = client_role(words.take())?;
        }
        words.end()?;
        let client = Client { peer, role: &|| role };
        Ok(Self::of(settings, source, unit, client, &request(function, address, count)))
    }

    /// What happens to a request.
    fn of(settings: &Settings, source: PortId, unit: u8, client: Client<'_>, request: &[u8]) -> Self {
        let rule = routing::deciding(settings, source, unit, client);
        let decision = routing::decide(settings, source, unit, client, request);
        let by_rules =
            matches!(routing::meaning(settings, source, unit), Special::Rules | Special::Replace(_));
        let lacks_role = rule.is_none() && by_rules && decision != Decision::NoRule;
        Self { rule, lacks_role, decision }
    }

    /// As a sentence.
    pub(crate) fn text<'e>(&'e self, settings: &'e Settings) -> impl fmt::Display + 'e {
        fmt::from_fn(move |f| {
            match self.rule {
                Some(nth) => write!(f, "rule {}: ", nth + 1)?,
                None if self.decision == Decision::NoRule => {}
                None if self.lacks_role => f.write_str("no rule is for its role: ")?,
                None => f.write_str("the port: ")?,
            }
            match self.decision {
                Decision::Forward { port, unit, .. } => {
                    write!(f, "to {} as unit {unit}", settings.name(port))
                }
                Decision::Local => f.write_str("to the gateway's own unit"),
                Decision::Discard => f.write_str("discarded, without a response"),
                Decision::Refuse(exception) => write!(f, "refused, {exception}"),
                Decision::Ignore { .. } => f.write_str("confirmed, but not executed"),
                Decision::AllLines => f.write_str("to all lines that rules lead to"),
                Decision::NoRule => {
                    f.write_str("no rule is for it: 0A to a TCP client, silence on a serial line")
                }
            }
        })
    }
}

/// A request with `count` zeros as values, if the function writes any.
fn request(function: u8, address: u16, count: u16) -> Pdu {
    let ([high, low], [count_high, count_low]) = (address.to_be_bytes(), count.to_be_bytes());
    let cells = usize::from(count);
    let (fields, length): ([u8; 9], usize) = match function {
        READ_COILS..=READ_INPUT_REGISTERS => ([function, high, low, count_high, count_low, 0, 0, 0, 0], 5),
        WRITE_SINGLE_COIL | WRITE_SINGLE_REGISTER => ([function, high, low, 0, 0, 0, 0, 0, 0], 5),
        WRITE_MULTIPLE_COILS => (
            [function, high, low, count_high, count_low, cells.div_ceil(8) as u8, 0, 0, 0],
            6 + cells.div_ceil(8),
        ),
        WRITE_MULTIPLE_REGISTERS => {
            ([function, high, low, count_high, count_low, count_low.wrapping_mul(2), 0, 0, 0], 6 + 2 * cells)
        }
        MASK_WRITE_REGISTER => ([function, high, low, 0, 0, 0, 0, 0, 0], 7),
        // The same addresses are read and written.
        READ_WRITE_MULTIPLE_REGISTERS => {
            ([function, high, low, count_high, count_low, high, low, count_high, count_low], 10 + 2 * cells)
        }
        READ_FIFO_QUEUE => ([function, high, low, 0, 0, 0, 0, 0, 0], 3),
        ENCAPSULATED_INTERFACE => ([function, MEI_DEVICE_IDENTIFICATION, 1, 0, 0, 0, 0, 0, 0], 4),
        _ => ([function, 0, 0, 0, 0, 0, 0, 0, 0], 1),
    };
    let mut request = Pdu::new();
    let most = request.capacity();
    // More values than fit in a frame are judged by their count, which is in the header.
    let _ = request.resize(length.min(most), 0);
    request.iter_mut().zip(fields).for_each(|(place, field)| *place = field);
    request
}
