//! A PTY with a thread at its far end that plays every unit of a line: at the pace of a wire, or at once.
//!
//! A PTY has no speed of its own. The thread takes a request as begun when it comes, lets pass the time that it would have
//! taken on the wire, the silence behind it and the turnaround time, and writes each character of the response when its last
//! bit would have come.

use std::io;
use std::num::NonZeroU64;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};

use mobgate::modbus::rtu;
use rustix::thread::set_current_timer_slack;
use serial2::SerialPort;

use crate::common::PATIENCE;

/// Registers that are read in one transaction.
const REGISTERS: usize = 10;
/// Function, byte count, registers.
const PDU_BYTES: usize = 2 + 2 * REGISTERS;
/// Unit, PDU, CRC.
pub(crate) const RESPONSE_CHARS: usize = PDU_BYTES + 3;
pub(crate) const EXCEPTION_CHARS: usize = 5;
const REQUEST_CHARS: usize = 8;
/// Addresses from here on the units do not have.
pub(crate) const NO_SUCH_ADDRESS: u16 = 0xff00;

/// FC 3 of ten registers.
pub(crate) fn request(address: u16) -> [u8; 5] {
    let [high, low] = address.to_be_bytes();
    [3, high, low, 0, REGISTERS as u8]
}

/// What every unit responds to that. Each register holds its own address, so that a wrong response is seen.
pub(crate) fn response_to(address: u16) -> Vec<u8> {
    if address >= NO_SUCH_ADDRESS {
        return vec![0x83, 2];
    }
    let registers = (0..REGISTERS as u16).flat_map(|at| address.wrapping_add(at).to_be_bytes());
    [3, 2 * REGISTERS as u8].into_iter().chain(registers).collect()
}

/// How long things take on the line.
#[derive(Clone, Copy)]
pub(crate) struct Pace {
    pub(crate) baud: u32,
    /// A character.
    character: Duration,
    /// The silence between frames.
    pub(crate) silence: Duration,
    /// From the silence behind the request to the response.
    turnaround: Duration,
}

impl Pace {
    /// As fast as the machine can.
    pub(crate) const NONE: Self = Self {
        baud: 115_200,
        character: Duration::ZERO,
        silence: Duration::ZERO,
        turnaround: Duration::ZERO,
    };

    /// A wire with characters of 11 bits, and units with 1 ms of turnaround time.
    pub(crate) fn of(baud: u32) -> Self {
        let character = Duration::from_secs(11) / baud;
        // Modbus over Serial Line 2.5.1.1.
        let silence = if baud > 19_200 { Duration::from_micros(1_750) } else { character * 7 / 2 };
        Self { baud, character, silence, turnaround: Duration::from_millis(1) }
    }

    /// From the first bit of a request to the last one of a response of `chars` characters.
    pub(crate) fn transaction(&self, chars: usize) -> Duration {
        self.character * (REQUEST_CHARS + chars) as u32 + self.silence + self.turnaround
    }

    /// The shortest legal time from one transaction to the next.
    pub(crate) fn period(&self) -> Duration {
        self.transaction(RESPONSE_CHARS) + self.silence
    }
}

/// What plays the units.
#[derive(Clone, Copy)]
pub(crate) struct Device {
    pub(crate) pace: Pace,
    /// Requests that do not keep the silence before them are not answered.
    pub(crate) strict: bool,
    /// This unit never responds.
    pub(crate) dead: Option<u8>,
}

impl Device {
    pub(crate) fn paced(baud: u32) -> Self {
        Self { pace: Pace::of(baud), strict: false, dead: None }
    }

    pub(crate) const UNPACED: Self = Self { pace: Pace::NONE, strict: false, dead: None };
}

/// What has come to the far end.
#[derive(Default)]
pub(crate) struct Heard {
    pub(crate) requests: AtomicU64,
    /// Requests that came before the line had been silent for long enough.
    pub(crate) early: AtomicU64,
}

/// A PTY and the device at its far end.
pub(crate) struct Line {
    /// The end where requests are sent.
    pub(crate) near: SerialPort,
    pub(crate) heard: Arc<Heard>,
}

impl Line {
    pub(crate) fn with(device: Device) -> Self {
        let (mut port, mut near) = SerialPort::pair().unwrap();
        near.set_read_timeout(PATIENCE).unwrap();
        port.set_read_timeout(PATIENCE).unwrap();
        let heard = Arc::<Heard>::default();
        let mut far = Far { port, device, heard: heard.clone(), busy_until: Instant::now() };
        thread::spawn(move || {
            // A wire keeps its time: without the 50 us that timers may be late by default. Not in the main thread, whose
            // programs would inherit it.
            let _ = set_current_timer_slack(NonZeroU64::new(1));
            while far.respond().is_ok() {}
        });
        Self { near, heard }
    }

    /// The near end's name.
    pub(crate) fn device(&self) -> String {
        rustix::termios::ttyname(&self.near, Vec::new()).unwrap().into_string().unwrap()
    }
}

/// The far end.
struct Far {
    port: SerialPort,
    device: Device,
    heard: Arc<Heard>,
    /// The last bit on the line.
    busy_until: Instant,
}

impl Far {
    /// Waits for a request and answers it; an error when the near end is closed.
    fn respond(&mut self) -> io::Result<()> {
        let Device { pace, strict, dead } = self.device;
        let mut request = [0; REQUEST_CHARS];
        match self.port.read_exact(&mut request) {
            // Others are measured meanwhile.
            Err(error) if error.kind() == io::ErrorKind::TimedOut => return Ok(()),
            read => read?,
        }
        let begun = Instant::now();
        let early = begun < self.busy_until + pace.silence;
        self.heard.requests.fetch_add(1, Relaxed);
        self.heard.early.fetch_add(early.into(), Relaxed);
        self.busy_until = begun + pace.character * REQUEST_CHARS as u32;
        let Ok((unit, [3, high, low, ..])) = rtu::decode(&request) else {
            // Out of step: what follows belongs to this.
            return self.port.discard_input_buffer();
        };
        if (early && strict) || dead == Some(unit) {
            return Ok(());
        }
        let mut frame = [0; rtu::FRAME_BYTES_MAX];
        let pdu = response_to(u16::from_be_bytes([*high, *low]));
        // The buffer has room for the longest PDU.
        self.send(
            self.busy_until + pace.silence + pace.turnaround,
            rtu::encode(unit, &pdu, &mut frame).unwrap(),
        )
    }

    /// Writes the characters of `frame`, which begins at `begin`, as they would come.
    fn send(&mut self, begin: Instant, frame: &[u8]) -> io::Result<()> {
        let character = self.device.pace.character;
        let mut sent = 0;
        while sent < frame.len() {
            sleep_until(begin + character * (sent as u32 + 1));
            self.busy_until = Instant::now();
            let passed = self.busy_until.saturating_duration_since(begin).as_nanos();
            let due = passed.checked_div(character.as_nanos()).map_or(frame.len(), |due| due as usize);
            let due = due.clamp(sent, frame.len());
            self.port.write_all(&frame[sent..due])?;
            sent = due;
        }
        Ok(())
    }
}

/// Sleeps until `moment`, if it has not passed.
pub(crate) fn sleep_until(moment: Instant) {
    let left = moment.saturating_duration_since(Instant::now());
    if !left.is_zero() {
        thread::sleep(left); // in the place of a wire, which takes its time
    }
}
