//! An RTU line with devices on it, served by a thread.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Read, Write};
use std::os::unix::net::UnixStream;
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use mobgate_simulator::device::{Memory, rtu};

/// Longest frame.
const FRAME_BYTES_MAX: usize = 256;

/// The devices on a line. Clones are the same.
#[derive(Clone)]
pub struct Bus(Arc<Mutex<Devices>>);

struct Devices {
    memories: BTreeMap<u8, Memory>,
    silent: BTreeSet<u8>,
    requests: u64,
    response_after: Duration,
    character: Duration,
}

impl Bus {
    /// Devices of these unit ids.
    pub fn new(units: impl IntoIterator<Item = u8>) -> Self {
        let memories = units.into_iter().map(|unit| (unit, Memory::new(unit))).collect();
        Self(Arc::new(Mutex::new(Devices {
            memories,
            silent: BTreeSet::new(),
            requests: 0,
            response_after: Duration::ZERO,
            character: Duration::ZERO,
        })))
    }

    /// Lets `unit` hear and not respond, or respond again.
    pub fn set_silent(&self, unit: u8, silent: bool) {
        let silent_units = &mut self.0.lock().unwrap().silent;
        if silent {
            silent_units.insert(unit)
        } else {
            silent_units.remove(&unit)
        };
    }

    /// Lets the devices respond so long after a request. The emulator carries bytes faster than a line would, and no response may
    /// come while the board must think that it still sends.
    pub fn response_after(&self, time: Duration) {
        self.0.lock().unwrap().response_after = time;
    }

    /// Lets each character of a response take so long.
    pub fn pace(&self, character: Duration) {
        self.0.lock().unwrap().character = character;
    }

    /// A holding register of `unit`.
    pub fn holding(&self, unit: u8, address: usize) -> u16 {
        self.0.lock().unwrap().memories[&unit].holding[address]
    }

    /// Calls `change` with what `unit` holds.
    pub fn with<T>(&self, unit: u8, change: impl FnOnce(&mut Memory) -> T) -> T {
        change(self.0.lock().unwrap().memories.get_mut(&unit).unwrap())
    }

    /// Requests for devices of this line that were heard.
    pub fn requests(&self) -> u64 {
        self.0.lock().unwrap().requests
    }

    /// Answers what comes by `line`, in a thread that ends with it.
    pub(crate) fn serve(&self, mut line: UnixStream) {
        let devices = self.0.clone();
        line.set_read_timeout(None).unwrap();
        thread::spawn(move || {
            let mut heard = Vec::new();
            let mut chunk = [0; FRAME_BYTES_MAX];
            while let Ok(count @ 1..) = line.read(&mut chunk) {
                heard.extend_from_slice(&chunk[..count]);
                // No silence ends a frame here, as the host paces nothing; when it is busy, the board may have given a device up
                // and asked another one by now.
                while heard.len() >= request_bytes(&heard) {
                    let rest = heard.split_off(request_bytes(&heard));
                    let response =
                        rtu::open(&heard).and_then(|(unit, pdu)| devices.lock().unwrap().response(unit, pdu));
                    heard = rest;
                    let (pause, character) = {
                        let devices = devices.lock().unwrap();
                        (devices.response_after, devices.character)
                    };
                    thread::sleep(pause);
                    if response.is_some_and(|response| send(&mut line, &response, character).is_err()) {
                        return;
                    }
                }
            }
        });
    }
}

/// Sends `bytes`, each when those before it would have taken their time on a wire.
pub(crate) fn send(line: &mut UnixStream, bytes: &[u8], character: Duration) -> io::Result<()> {
    if character.is_zero() {
        return line.write_all(bytes);
    }
    let start = Instant::now();
    for (before, &byte) in (0..).zip(bytes) {
        thread::sleep((character * before).saturating_sub(start.elapsed()));
        line.write_all(&[byte])?;
    }
    Ok(())
}

/// How long a request is that begins like this: reads and writes of one thing, writes of several, or questions who a unit is. (A CRC
/// that fits is no end: it does so one byte early in one of 256 requests for few registers.)
fn request_bytes(begun: &[u8]) -> usize {
    match begun {
        [_, 17, ..] => 4,
        [_, 43, ..] => 7,
        [_, 15 | 16, _, _, _, _, bytes, ..] => 9 + usize::from(*bytes),
        [_, 15 | 16, ..] => 9,
        _ => 8,
    }
}

impl Devices {
    fn response(&mut self, unit: u8, pdu: &[u8]) -> Option<Vec<u8>> {
        let memory = self.memories.get_mut(&unit)?;
        self.requests += 1;
        if self.silent.contains(&unit) {
            return None;
        }
        let response = memory.execute(pdu).unwrap_or_else(|exception| vec![pdu[0] | 0x80, exception]);
        Some(rtu::frame(unit, &response))
    }
}
