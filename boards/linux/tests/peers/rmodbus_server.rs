//! An RTU server by rmodbus.

use std::array::from_fn;
use std::path::Path;
use std::thread;

use rmodbus::server::ModbusFrame;
use rmodbus::server::storage::ModbusStorageSmall;
use rmodbus::{ModbusProto, guess_request_frame_len};
use serial2::SerialPort;

use crate::common::PATIENCE;
use crate::lines::first_input;

/// Responds as `unit` at `device` until the line hangs up.
pub(crate) fn start(device: &Path, unit: u8) {
    let mut line = SerialPort::open(device, 115_200).unwrap();
    line.set_read_timeout(PATIENCE).unwrap();
    let mut storage = ModbusStorageSmall::new();
    storage.inputs = from_fn(|address| first_input(unit).wrapping_add(address as u16));
    storage.discretes = from_fn(|address| address % 3 == 0);
    thread::spawn(move || {
        while let Some(request) = read_request(&mut line) {
            let response = respond(unit, &request, &mut storage);
            if line.write_all(&response).is_err() {
                return;
            }
        }
    });
}

/// The next request, whose end rmodbus knows from its beginning.
fn read_request(line: &mut SerialPort) -> Option<Vec<u8>> {
    let mut request = Vec::new();
    let mut byte = [0];
    loop {
        line.read_exact(&mut byte).ok()?;
        request.extend(byte);
        let length = guess_request_frame_len(&request, ModbusProto::Rtu);
        if length.is_ok_and(|length| request.len() >= usize::from(length)) {
            return Some(request);
        }
    }
}

fn respond(unit: u8, request: &[u8], storage: &mut ModbusStorageSmall) -> Vec<u8> {
    let mut response = Vec::new();
    let mut frame = ModbusFrame::new(unit, request, ModbusProto::Rtu, &mut response);
    frame.parse().unwrap();
    if frame.processing_required {
        if frame.readonly { frame.process_read(storage) } else { frame.process_write(storage) }.unwrap();
    }
    if frame.response_required {
        frame.finalize_response().unwrap();
    }
    response
}
