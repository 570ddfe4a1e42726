//! The SPI: instruction, address, then double words, while the select line is low.

use std::cell::RefCell;
use std::rc::Rc;

use embassy_time::Timer;
use embedded_hal::spi::{ErrorKind, ErrorType, Operation};
use embedded_hal_async::spi::SpiDevice;

use super::device::Device;
use crate::{Nanos, now};

const WRITE: u8 = 0x02;
const READ: u8 = 0x03;
const FAST_READ: u8 = 0x0B;
const ADDRESS: u16 = 0x3FFF;
const INCREMENT: u16 = 0x4000;
const DECREMENT: u16 = 0x8000;
const NANOS_PER_SECOND: u64 = 1_000_000_000;
/// The level of an undriven line.
const FLOATING: u8 = 0xFF;

/// The processor's SPI, with the chip on its select line.
pub struct Spi {
    device: Rc<RefCell<Device>>,
    /// Time passed on the SPI beyond the clock's whole microseconds.
    owed: Nanos,
}

/// The pins of the SPI, for a processor that is emulated itself: it tells its own time with each byte.
pub struct Pins {
    device: Rc<RefCell<Device>>,
    session: Option<Session>,
}

impl Pins {
    pub(super) fn new(device: Rc<RefCell<Device>>) -> Self {
        Self { device, session: None }
    }

    /// The select line goes low, or high again.
    pub fn select(&mut self, is_low: bool, at: Nanos) {
        if is_low && self.session.is_none() {
            self.device.borrow_mut().traffic.selects += 1;
            self.session = Some(Session::default());
        } else if !is_low && let Some(session) = self.session.take() {
            session.end(&mut self.device.borrow_mut(), at);
        }
    }

    /// A byte goes out while another one comes back. Without the select line low nobody listens.
    pub fn exchange(&mut self, out: u8, at: Nanos) -> u8 {
        let Some(session) = &mut self.session else { return FLOATING };
        let device = &mut *self.device.borrow_mut();
        device.traffic.bytes += 1;
        session.exchange(device, out, at)
    }

    /// The level of the interrupt pin.
    pub fn interrupt(&self, at: Nanos) -> bool {
        self.device.borrow_mut().pin(at)
    }
}

/// A transaction so far.
#[derive(Default)]
struct Session {
    bytes: usize,
    instruction: u8,
    address: u16,
    word: [u8; 4],
}

impl Spi {
    pub(super) fn new(device: Rc<RefCell<Device>>) -> Self {
        Self { device, owed: 0 }
    }

    /// Lets time pass, in whole microseconds.
    async fn pass(&mut self, nanos: Nanos) {
        self.owed += nanos;
        if self.owed >= 1_000 {
            Timer::after_micros(self.owed / 1_000).await;
            self.owed %= 1_000;
        }
    }

    async fn exchange(&mut self, session: &mut Session, out: u8) -> u8 {
        let byte_nanos = 8 * NANOS_PER_SECOND / self.device.borrow().timing.spi_hz;
        self.pass(byte_nanos).await;
        let device = &mut *self.device.borrow_mut();
        device.traffic.bytes += 1;
        let out = flip(device, out);
        let back = session.exchange(device, out, now() + self.owed);
        flip(device, back)
    }
}

/// Flips a bit if faults demand it.
fn flip(device: &mut Device, byte: u8) -> u8 {
    if device.faults.flipped == 0.0 || !device.random.chance(device.faults.flipped) {
        return byte;
    }
    device.tainted = true;
    device.injected += 1;
    byte ^ 1 << device.random.index(8)
}

impl Session {
    fn exchange(&mut self, device: &mut Device, out: u8, at: Nanos) -> u8 {
        let nth = self.bytes;
        self.bytes += 1;
        let head = if self.instruction == FAST_READ { 4 } else { 3 };
        match nth {
            0 => {
                self.instruction = out;
                if ![WRITE, READ, FAST_READ].contains(&out) {
                    device.violation(at, &format!("instruction {out:#04x}, which this model does not know"));
                }
            }
            1 | 2 => {
                self.address = self.address << 8 | u16::from(out);
                if nth == 2 && !self.address.is_multiple_of(4) {
                    device.violation(at, "address that is not that of a double word");
                }
            }
            3 if head == 4 => {}
            _ => return self.data(device, (nth - head) % 4, out, at),
        }
        FLOATING
    }

    fn data(&mut self, device: &mut Device, lane: usize, out: u8, at: Nanos) -> u8 {
        let register = self.address & ADDRESS;
        match self.instruction {
            READ | FAST_READ => {
                if lane == 0 {
                    self.word = device.read_register(register, at).to_le_bytes();
                    self.step();
                }
                self.word[lane]
            }
            WRITE => {
                self.word[lane] = out;
                if lane == 3 {
                    device.write_register(register, u32::from_le_bytes(self.word), at);
                    self.step();
                }
                FLOATING
            }
            _ => FLOATING,
        }
    }

    fn step(&mut self) {
        let register = match self.address & (INCREMENT | DECREMENT) {
            INCREMENT => self.address.wrapping_add(4),
            DECREMENT => self.address.wrapping_sub(4),
            _ => self.address,
        };
        self.address = self.address & !ADDRESS | register & ADDRESS;
    }

    fn end(&self, device: &mut Device, at: Nanos) {
        let head = if self.instruction == FAST_READ { 4 } else { 3 };
        if self.bytes < head || !(self.bytes - head).is_multiple_of(4) {
            device.violation(at, "transaction that ends inside of a double word");
        }
        device.settle();
    }
}

impl ErrorType for Spi {
    type Error = ErrorKind;
}

impl SpiDevice for Spi {
    async fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), ErrorKind> {
        let select_nanos = {
            let device = &mut *self.device.borrow_mut();
            device.traffic.selects += 1;
            let probability = device.faults.failed;
            if probability > 0.0 && device.random.chance(probability) {
                device.tainted = true;
                device.injected += 1;
                return Err(ErrorKind::Other);
            }
            device.timing.select_nanos
        };
        self.pass(select_nanos).await;
        let mut session = Session::default();
        for operation in operations {
            match operation {
                Operation::Read(into) => {
                    for byte in into.iter_mut() {
                        *byte = self.exchange(&mut session, 0).await;
                    }
                }
                Operation::Write(from) => {
                    for byte in *from {
                        self.exchange(&mut session, *byte).await;
                    }
                }
                Operation::Transfer(into, from) => {
                    for nth in 0..into.len().max(from.len()) {
                        let back = self.exchange(&mut session, from.get(nth).copied().unwrap_or(0)).await;
                        if let Some(place) = into.get_mut(nth) {
                            *place = back;
                        }
                    }
                }
                Operation::TransferInPlace(bytes) => {
                    for byte in bytes.iter_mut() {
                        *byte = self.exchange(&mut session, *byte).await;
                    }
                }
                Operation::DelayNs(nanos) => self.pass(u64::from(*nanos)).await,
            }
        }
        session.end(&mut self.device.borrow_mut(), now() + self.owed);
        Ok(())
    }
}
