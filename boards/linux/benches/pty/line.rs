//! A PTY with a thread at its far end that answers every request at once.

use std::thread;

use common::PATIENCE;
use mobgate::modbus::rtu;
use serial2::SerialPort;

use crate::common;

/// Registers that are read in one transaction.
const REGISTERS: usize = 10;
/// Function, byte count, registers.
pub(crate) const PDU_BYTES: usize = 2 + 2 * REGISTERS;
/// Unit, PDU, CRC.
pub(crate) const ANSWER_BYTES: usize = PDU_BYTES + 3;
const REQUEST_BYTES: usize = 8;

/// FC 3 of ten registers.
pub(crate) fn request(address: u16) -> [u8; 5] {
    let [high, low] = address.to_be_bytes();
    [3, high, low, 0, REGISTERS as u8]
}

/// Each register holds its own address, so that a wrong answer is seen.
pub(crate) fn answer_pdu(address: u16) -> [u8; PDU_BYTES] {
    let mut pdu = [0; PDU_BYTES];
    (pdu[0], pdu[1]) = (3, 2 * REGISTERS as u8);
    for (register, at) in pdu[2..].chunks_exact_mut(2).zip(0..) {
        register.copy_from_slice(&address.wrapping_add(at).to_be_bytes());
    }
    pdu
}

/// A PTY with a responder.
pub(crate) struct Line {
    /// The end where requests are sent.
    pub(crate) near: SerialPort,
}

impl Line {
    pub(crate) fn with_responder() -> Self {
        let (mut far, mut near) = SerialPort::pair().unwrap();
        near.set_read_timeout(PATIENCE).unwrap();
        far.set_read_timeout(PATIENCE).unwrap();
        thread::spawn(move || while respond(&mut far).is_ok() {});
        Self { near }
    }

    /// The near end's name.
    pub(crate) fn device(&self) -> String {
        rustix::termios::ttyname(&self.near, Vec::new()).unwrap().into_string().unwrap()
    }
}

fn respond(line: &mut SerialPort) -> std::io::Result<()> {
    let mut request = [0; REQUEST_BYTES];
    line.read_exact(&mut request)?;
    let [unit, _, high, low, ..] = request;
    let mut frame = [0; rtu::FRAME_BYTES_MAX];
    let pdu = answer_pdu(u16::from_be_bytes([high, low]));
    // The buffer has room for the longest PDU.
    line.write_all(rtu::encode(unit, &pdu, &mut frame).unwrap())
}
