//! The gateway's own unit: answers what a rule sends to `local`.
//!
//! It knows the loop-back test (FC 08 sub-function 0) and the report of the server id (FC 11h), so that a client can
//! tell that the gateway lives, and on ASCII lines the change of the character that ends frames (FC 08 sub-function 3).
//! Where points are `local`, it has them in its tables (FC 01 to 06, 15, 16); everything else is answered 01h.

use embassy_time::Instant;

use crate::config::{Framing, PortKind};
use crate::frame::Frame;
use crate::gateway::Gateway;
use crate::modbus::{Exception, PDU_BYTES_MAX, pdu};
use crate::scanner::Pdu;

/// Run indicator of FC 11h: on (Application Protocol 6.13).
const RUNNING: u8 = 0xff;
/// The gateway's name in FC 11h.
const SERVER_ID: &[u8] = concat!("mobgate ", env!("CARGO_PKG_VERSION")).as_bytes();

/// Answers `frame` and sends it home.
pub(crate) fn answer(gateway: &Gateway<'_>, frame: Frame<'_>) {
    let mut request = [0; PDU_BYTES_MAX];
    let length = frame.copy_pdu(&mut request);
    let fits = match request.get(..length).unwrap_or(&[]) {
        // The answer repeats the request, which is in the frame already (Application Protocol 6.8).
        [8, 0, 0, ..] => Ok(()),
        // A character that is part of frames cannot end them.
        [8, 0, 3, b'0'..=b'9' | b'A'..=b'F' | b':' | b'\r', 0] if on_ascii(gateway, &frame) => {
            return gateway.refuse(frame, Exception::ILLEGAL_VALUE);
        }
        // The port that the request came by changes the character, behind this answer.
        [8, 0, 3, _, 0] if on_ascii(gateway, &frame) => Ok(()),
        [17] => {
            let mut writer = frame.rewrite();
            let header = [17, SERVER_ID.len() as u8 + 1];
            let written = writer.push(&header).and(writer.push(SERVER_ID)).and(writer.push(&[RUNNING]));
            writer.finish();
            written
        }
        request => match from_table(gateway, request) {
            Ok(answer) => frame.replace(&answer),
            Err(exception) => return gateway.refuse(frame, exception),
        },
    };
    match fits {
        Ok(()) => gateway.answered(frame),
        Err(_) => gateway.refuse(frame, Exception::DEVICE_FAILURE),
    }
}

/// What the local points say to `request`.
fn from_table(gateway: &Gateway<'_>, request: &[u8]) -> Result<Pdu, Exception> {
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
fn on_ascii(gateway: &Gateway<'_>, frame: &Frame<'_>) -> bool {
    let port = frame.envelope().origin.port;
    gateway.settings(|settings| {
        let kind = settings.port(port).map(|port| &port.kind);
        matches!(kind, Some(PortKind::Serial(serial)) if serial.framing == Framing::Ascii)
    })
}
