//! The gateway's own unit: responds to what a rule sends to `local`.
//!
//! Diagnostics (FC 08) and the communication event functions (0B, 0C) report on the port that the request came by; FC 11h and
//! device identification (2Bh/0Eh) describe the gateway. Points marked `local` are in its tables (FC 01 to 06, 15, 16), followed
//! by registers with the state of the gateway ([`table`]), which include the EtherCAT process image, and registers that operate
//! data points ([`points`]). Everything else gets 01h.

use embassy_time::Instant;

use crate::frame::{Envelope, Frame};
use crate::gateway::Gateway;
use crate::modbus::pdu::function::{
    DIAGNOSTICS, ENCAPSULATED_INTERFACE, GET_COMM_EVENT_COUNTER, GET_COMM_EVENT_LOG,
    MEI_DEVICE_IDENTIFICATION, REPORT_SERVER_ID,
};
use crate::modbus::{Exception, Pdu, pdu};
use crate::settings::{Framing, PortKind};

mod diagnostics;
mod identification;
pub mod image;
pub mod points;
mod response;
pub mod table;

use diagnostics::Mode;
use response::{Answered, put};

/// Run indicator of FC 11h: on (Application Protocol 6.13).
const RUNNING: u8 = 0xff;
/// The gateway's name in FC 11h.
const SERVER_ID: &[u8] = concat!("mobgate ", env!("CARGO_PKG_VERSION")).as_bytes();

/// Responds to `frame` and returns it to the router.
// Kept out of the routing task's code: it is a port like the others, though without a task.
#[inline(never)]
pub(crate) fn respond(gateway: &Gateway<'_>, frame: Frame<'_>) {
    let request = &frame.content();
    let envelope = frame.envelope();
    let mut response = Pdu::new();
    let answered = match diagnostics::mode(gateway, envelope.origin.port, request) {
        Mode::Silent => return gateway.unanswered(frame),
        Mode::Restarted => put(&mut response, &[request]),
        Mode::Refused => Err(Exception::ILLEGAL_VALUE),
        Mode::Responds => by_function(gateway, &envelope, request, &mut response),
    };
    gateway.events(|events| events.note(request, envelope.unit == 0, answered));
    match answered {
        Ok(()) => {
            // Fits: no longer than a PDU may be.
            let _ = frame.replace(&response);
            gateway.answered(frame);
        }
        Err(exception) => gateway.refuse(frame, exception),
    }
}

/// Writes the response to `request`.
fn by_function(gateway: &Gateway<'_>, envelope: &Envelope, request: &[u8], response: &mut Pdu) -> Answered {
    match *request {
        // A character that occurs inside frames cannot end them.
        [DIAGNOSTICS, 0, 3, b'0'..=b'9' | b'A'..=b'F' | b':' | b'\r', 0] if on_ascii(gateway, envelope) => {
            Err(Exception::ILLEGAL_VALUE)
        }
        // The serial port changes the delimiter itself, after sending this response.
        [DIAGNOSTICS, 0, 3, _, 0] if on_ascii(gateway, envelope) => put(response, &[request]),
        [DIAGNOSTICS, high, low, ref data @ ..] => diagnostics::respond(
            gateway,
            envelope.origin.port,
            u16::from_be_bytes([high, low]),
            data,
            response,
        ),
        [GET_COMM_EVENT_COUNTER] => gateway.events(|events| put(response, &[request, &events.counter()])),
        [GET_COMM_EVENT_LOG] => {
            let messages = diagnostics::messages(gateway, envelope.origin.port);
            gateway.events(|events| diagnostics::event_log(events, messages, response))
        }
        [REPORT_SERVER_ID] => {
            put(response, &[&[REPORT_SERVER_ID, SERVER_ID.len() as u8 + 1], SERVER_ID, &[RUNNING]])
        }
        [ENCAPSULATED_INTERFACE, MEI_DEVICE_IDENTIFICATION, code, object] => {
            identification::respond(code, object, response)
        }
        _ => from_tables(gateway, request, response),
    }
}

/// Reads and writes the local points, and otherwise the table of the gateway's state.
fn from_tables(gateway: &Gateway<'_>, request: &[u8], response: &mut Pdu) -> Answered {
    match from_points(gateway, request) {
        Ok(of_points) => put(response, &[&of_points]),
        Err(exception @ (Exception::ILLEGAL_ADDRESS | Exception::ILLEGAL_FUNCTION)) => {
            table::respond(gateway, request, response).unwrap_or(Err(exception))
        }
        Err(exception) => Err(exception),
    }
}

fn from_points(gateway: &Gateway<'_>, request: &[u8]) -> Result<Pdu, Exception> {
    let points = gateway.scanner().filter(|scanner| scanner.with(|scanner| scanner.serves()));
    let points = points.ok_or(Exception::ILLEGAL_FUNCTION)?;
    let now = Instant::now();
    if pdu::is_read(request) {
        points.with(|scanner| scanner.serve(request, now))
    } else {
        let served = points.change(|scanner| scanner.serve(request, now));
        gateway.values_changed();
        served
    }
}

/// Whether the request came by an ASCII line.
fn on_ascii(gateway: &Gateway<'_>, envelope: &Envelope) -> bool {
    gateway.settings(|settings| {
        let kind = settings.port(envelope.origin.port).map(|port| &port.kind);
        matches!(kind, Some(PortKind::Serial(serial)) if serial.framing == Framing::Ascii)
    })
}
