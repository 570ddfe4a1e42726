//! A Modbus TCP device that knows what was written to it: functions 3 and 6, of any unit. From register 40000 on it is a SunSpec
//! device with the common model.

use std::io::{Read, Write};
use std::sync::{Arc, Mutex};
use std::thread;

use crate::common::listening;

/// The first register of SunSpec's map.
const SUNSPEC: u16 = 40_000;
/// Registers of the common model behind its id and its length.
const COMMON_LENGTH: u16 = 66;
const MAKER: &[u8] = b"Peerworks";

/// A device on a port of its own.
pub(crate) struct Device {
    pub(crate) port: u16,
    written: Arc<Mutex<Vec<(u16, u16)>>>,
}

fn register(address: u16) -> u16 {
    match address.checked_sub(SUNSPEC) {
        None => address,
        Some(0) => u16::from_be_bytes(*b"Su"),
        Some(1) => u16::from_be_bytes(*b"nS"),
        Some(2) => 1,
        Some(3) => COMMON_LENGTH,
        Some(at) if at < 4 + COMMON_LENGTH => {
            let at = 2 * usize::from(at - 4);
            let byte = |at: usize| u16::from(MAKER.get(at).copied().unwrap_or(0));
            byte(at) << 8 | byte(at + 1)
        }
        Some(at) if at == 4 + COMMON_LENGTH => 0xffff,
        Some(_) => 0,
    }
}

impl Device {
    pub(crate) fn start() -> Self {
        let (listener, port) = listening();
        let written = Arc::<Mutex<Vec<(u16, u16)>>>::default();
        let noted = written.clone();
        thread::spawn(move || {
            for stream in listener.incoming().map_while(Result::ok) {
                let noted = noted.clone();
                thread::spawn(move || serve(stream, &noted));
            }
        });
        Self { port, written }
    }

    /// Addresses and values that were written, in this order.
    pub(crate) fn written(&self) -> Vec<(u16, u16)> {
        self.written.lock().unwrap().clone()
    }
}

/// Responds until the stream ends.
pub(crate) fn serve(mut stream: impl Read + Write, written: &Mutex<Vec<(u16, u16)>>) -> Option<()> {
    loop {
        let mut head = [0; 7];
        stream.read_exact(&mut head).ok()?;
        let mut request = vec![0; usize::from(u16::from_be_bytes([head[4], head[5]])) - 1];
        stream.read_exact(&mut request).ok()?;
        let [_, a, b, c, d] = request[..] else { panic!("{request:?}") };
        let (address, value) = (u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d]));
        let mut response = vec![request[0]];
        match request[0] {
            3 => {
                response.push((2 * value) as u8);
                (address..address + value).for_each(|at| response.extend(register(at).to_be_bytes()));
            }
            6 => {
                written.lock().unwrap().push((address, value));
                response = request;
            }
            function => response = vec![function | 0x80, 1],
        }
        head[4..6].copy_from_slice(&(response.len() as u16 + 1).to_be_bytes());
        stream.write_all(&[&head[..], &response].concat()).ok()?;
        stream.flush().ok()?;
    }
}
