//! The gateway's own unit: answers what a rule sends to `local`.
//!
//! Diagnostics (FC 08) and the communication event functions (0B, 0C) speak of the port that the request came by; FC 11h and the
//! device identification (2Bh/0Eh) say what the gateway is. Where points are `local`, it has them in its tables (FC 01 to
//! 06, 15, 16); behind them are input registers with the state of everything ([`table`]), the EtherCAT process image among it. All else is answered 01h.

use embassy_time::Instant;

use crate::config::{Framing, PortKind};
use crate::frame::{Envelope, Frame};
use crate::gateway::Gateway;
use crate::modbus::Pdu;
use crate::modbus::pdu::function::{
    DIAGNOSTICS, ENCAPSULATED_INTERFACE, GET_COMM_EVENT_COUNTER, GET_COMM_EVENT_LOG,
    MEI_DEVICE_IDENTIFICATION, REPORT_SERVER_ID,
};
use crate::modbus::{Exception, pdu};

mod diagnostics;
mod identification;
mod image;
pub mod table;

pub(crate) use diagnostics::Events;
use diagnostics::Mode;

/// Run indicator of FC 11h: on (Application Protocol 6.13).
const RUNNING: u8 = 0xff;
/// The gateway's name in FC 11h.
const SERVER_ID: &[u8] = concat!("mobgate ", env!("CARGO_PKG_VERSION")).as_bytes();

/// Answers `frame` and sends it home.
pub(crate) fn answer(gateway: &Gateway<'_>, frame: Frame<'_>) {
    let request = &frame.content();
    let envelope = frame.envelope();
    let answer = match diagnostics::mode(gateway, envelope.origin.port, request) {
        Mode::Silent => return gateway.unanswered(frame),
        Mode::Restarted => pdu_of(&[request]),
        Mode::Refused => Err(Exception::ILLEGAL_VALUE),
        Mode::Answers => respond(gateway, &envelope, request),
    };
    gateway.events(|events| events.note(request, envelope.unit == 0, &answer));
    match answer.map(|answer| frame.replace(&answer)) {
        Ok(Ok(())) => gateway.answered(frame),
        Ok(Err(_)) => gateway.refuse(frame, Exception::DEVICE_FAILURE),
        Err(exception) => gateway.refuse(frame, exception),
    }
}

/// The answer to `request`.
fn respond(gateway: &Gateway<'_>, envelope: &Envelope, request: &[u8]) -> Result<Pdu, Exception> {
    match *request {
        // A character that is part of frames cannot end them.
        [DIAGNOSTICS, 0, 3, b'0'..=b'9' | b'A'..=b'F' | b':' | b'\r', 0] if on_ascii(gateway, envelope) => {
            Err(Exception::ILLEGAL_VALUE)
        }
        // The port that the request came by changes the character, behind this answer.
        [DIAGNOSTICS, 0, 3, _, 0] if on_ascii(gateway, envelope) => pdu_of(&[request]),
        [DIAGNOSTICS, high, low, ref data @ ..] => {
            diagnostics::answer(gateway, envelope.origin.port, u16::from_be_bytes([high, low]), data)
        }
        [GET_COMM_EVENT_COUNTER] => gateway.events(|events| pdu_of(&[request, &events.counter()])),
        [GET_COMM_EVENT_LOG] => {
            let messages = diagnostics::messages(gateway, envelope.origin.port);
            gateway.events(|events| events.log(messages))
        }
        [REPORT_SERVER_ID] => {
            pdu_of(&[&[REPORT_SERVER_ID, SERVER_ID.len() as u8 + 1], SERVER_ID, &[RUNNING]])
        }
        [ENCAPSULATED_INTERFACE, MEI_DEVICE_IDENTIFICATION, code, object] => {
            identification::answer(code, object)
        }
        _ => from_tables(gateway, request),
    }
}

/// The PDU of `parts`.
fn pdu_of(parts: &[&[u8]]) -> Result<Pdu, Exception> {
    let mut pdu = Pdu::new();
    let written = parts.iter().try_for_each(|part| pdu.extend_from_slice(part));
    written.map(|()| pdu).map_err(|_| Exception::DEVICE_FAILURE)
}

/// What the local points say to `request`, and behind them the table of the gateway's state.
fn from_tables(gateway: &Gateway<'_>, request: &[u8]) -> Result<Pdu, Exception> {
    let from_points = from_points(gateway, request);
    match from_points {
        Err(Exception::ILLEGAL_ADDRESS | Exception::ILLEGAL_FUNCTION) => {
            table::answer(gateway, request).unwrap_or(from_points)
        }
        answer => answer,
    }
}

fn from_points(gateway: &Gateway<'_>, request: &[u8]) -> Result<Pdu, Exception> {
    let points = gateway.scanner().filter(|scanner| scanner.with(|scanner| scanner.serves()));
    let points = points.ok_or(Exception::ILLEGAL_FUNCTION)?;
    let now = Instant::now();
    if request.first().is_some_and(|function| pdu::is_read(*function)) {
        points.with(|scanner| scanner.serve(request, now))
    } else {
        points.change(|scanner| scanner.serve(request, now))
    }
}

/// Whether the request came by an ASCII line.
fn on_ascii(gateway: &Gateway<'_>, envelope: &Envelope) -> bool {
    gateway.settings(|settings| {
        let kind = settings.port(envelope.origin.port).map(|port| &port.kind);
        matches!(kind, Some(PortKind::Serial(serial)) if serial.framing == Framing::Ascii)
    })
}
