//! The CMSDK UARTs, driven by interrupts through ring buffers.
//!
//! QEMU holds back what a full receiver cannot take, so no byte is ever lost: when the buffer is full, the receiver's interrupt
//! is off until the task has read. As with a DMA channel and an idle line's interrupt, a task is not woken for each byte but for
//! a piece, or when nothing has come for a while.

use core::convert::Infallible;
use core::future::poll_fn;
use core::task::Poll;

use embassy_hal_internal::atomic_ring_buffer::RingBuffer;
use embassy_sync::waitqueue::AtomicWaker;
use embedded_io_async::{ErrorType, Read, Write};
use mobgate::hal::{Flaws, SerialLine};
use static_cell::ConstStaticCell;

use crate::interrupts::{self, Interrupt};
use crate::measure;
use crate::register::Register;

/// UARTs of the machine.
pub(crate) const COUNT: usize = 5;
/// Bytes of each direction that a UART holds: two frames.
const BUFFER_BYTES: usize = 512;
/// The clock that baud rates are divided from.
pub(crate) const CLOCK_HZ: u32 = 25_000_000;
/// Least divisor that the hardware takes.
pub(crate) const DIVISOR_MIN: u32 = 16;

/// A task is woken when so many bytes are there.
const PIECE_BYTES: usize = 64;
/// It is woken for fewer when no UART has received any for 250 us: two characters at 115200 baud, in cycles of the timer.
const IDLE_CYCLES: u32 = CLOCK_HZ / 4_000;
const IDLE_TIMER: usize = 0x4000_1000;
const IDLE_CONTROL: Register = Register::at(IDLE_TIMER, 0x0);
const IDLE_VALUE: Register = Register::at(IDLE_TIMER, 0x4);
const IDLE_RELOAD: Register = Register::at(IDLE_TIMER, 0x8);
const IDLE_CLEAR: Register = Register::at(IDLE_TIMER, 0xc);
const IDLE_START: u32 = 1 | 1 << 3;

const TRANSMITTER_FULL: u32 = 1;
const RECEIVER_FULL: u32 = 1 << 1;
/// Cleared by writing it.
const RECEIVER_OVERRUN: u32 = 1 << 3;
const TRANSMIT: u32 = 1;
const RECEIVE: u32 = 1 << 1;
const TRANSMIT_INTERRUPT: u32 = 1 << 2;
const RECEIVE_INTERRUPT: u32 = 1 << 3;

static UARTS: [Uart; COUNT] = [
    Uart::at(0x4000_4000),
    Uart::at(0x4000_5000),
    Uart::at(0x4000_6000),
    Uart::at(0x4000_7000),
    Uart::at(0x4000_9000),
];

struct Uart {
    data: Register,
    state: Register,
    control: Register,
    interrupts: Register,
    divisor: Register,
    received: RingBuffer,
    to_send: RingBuffer,
    arrived: AtomicWaker,
    room: AtomicWaker,
}

/// Starts all UARTs.
pub(crate) fn start() {
    static BUFFERS: ConstStaticCell<[[[u8; BUFFER_BYTES]; 2]; COUNT]> =
        ConstStaticCell::new([[[0; BUFFER_BYTES]; 2]; COUNT]);
    let buffers = BUFFERS.take();
    for ((uart, [received, to_send]), Interrupt(interrupt)) in
        UARTS.iter().zip(buffers).zip(interrupts::UARTS)
    {
        // SAFETY: the buffers live as long as the program and have no other owner; nothing uses the rings yet.
        unsafe {
            uart.received.init(received.as_mut_ptr(), received.len());
            uart.to_send.init(to_send.as_mut_ptr(), to_send.len());
        }
        uart.divisor.write(DIVISOR_MIN);
        uart.control.write(TRANSMIT | RECEIVE | TRANSMIT_INTERRUPT | RECEIVE_INTERRUPT);
        interrupts::enable(Interrupt(interrupt));
        interrupts::enable(Interrupt(interrupt + 1));
    }
    IDLE_RELOAD.write(IDLE_CYCLES);
    interrupts::enable(interrupts::TIMER_1);
}

/// Nothing has come for a while.
pub(crate) extern "C" fn on_idle() {
    IDLE_CONTROL.write(0);
    IDLE_CLEAR.write(1);
    wake_readers();
}

/// Wakes all at once, so that a busy line does not keep the end of another's frame waiting.
fn wake_readers() {
    UARTS.iter().filter(|uart| !uart.received.is_empty()).for_each(|uart| uart.arrived.wake());
}

pub(crate) extern "C" fn on_receive<const N: usize>() {
    UARTS[N].interrupts.write(RECEIVE);
    UARTS[N].receive();
}

pub(crate) extern "C" fn on_transmit<const N: usize>() {
    UARTS[N].interrupts.write(TRANSMIT);
    UARTS[N].transmit();
}

impl Uart {
    const fn at(base: usize) -> Self {
        Self {
            data: Register::at(base, 0x0),
            state: Register::at(base, 0x4),
            control: Register::at(base, 0x8),
            interrupts: Register::at(base, 0xc),
            divisor: Register::at(base, 0x10),
            received: RingBuffer::new(),
            to_send: RingBuffer::new(),
            arrived: AtomicWaker::new(),
            room: AtomicWaker::new(),
        }
    }

    /// Takes what the receiver has, as far as there is room. By the interrupt, or with interrupts masked.
    fn receive(&self) {
        measure::in_driver(|| self.move_received());
        if self.received.available() >= PIECE_BYTES {
            wake_readers();
        }
    }

    fn move_received(&self) {
        // SAFETY: there is one writer at a time, see above.
        let mut ring = unsafe { self.received.writer() };
        while self.state.read() & RECEIVER_FULL != 0 {
            let count = ring.push(|room| match room.first_mut() {
                Some(place) => {
                    *place = self.data.read() as u8;
                    1
                }
                None => 0,
            });
            if count == 0 {
                self.control.write(self.control.read() & !RECEIVE_INTERRUPT);
                break;
            }
        }
        IDLE_VALUE.write(IDLE_CYCLES);
        IDLE_CONTROL.write(IDLE_START);
    }

    /// Gives the transmitter what it takes. By the interrupt, or with interrupts masked.
    fn transmit(&self) {
        measure::in_driver(|| {
            // SAFETY: there is one reader at a time, see above.
            let mut ring = unsafe { self.to_send.reader() };
            while self.state.read() & TRANSMITTER_FULL == 0 {
                let Some(byte) = ring.pop_one() else { break };
                self.data.write(byte.into());
            }
        });
        self.room.wake();
    }

    /// Moves received bytes to `into`.
    fn take(&self, into: &mut [u8]) -> usize {
        // SAFETY: the line's one owner calls this.
        let mut ring = unsafe { self.received.reader() };
        let mut count = 0;
        // Twice, as the ring's end may part what there is.
        for _ in 0..2 {
            count += ring.pop(|bytes| {
                let rest = into.get_mut(count..).unwrap_or_default();
                let length = bytes.len().min(rest.len());
                rest[..length].copy_from_slice(&bytes[..length]);
                length
            });
        }
        if count > 0 && self.control.read() & RECEIVE_INTERRUPT == 0 {
            critical_section::with(|_| {
                self.control.write(self.control.read() | RECEIVE_INTERRUPT);
                // What came while it was off has made no interrupt.
                self.receive();
            });
        }
        count
    }

    /// Moves bytes of `from` to the transmitter's buffer.
    fn put(&self, from: &[u8]) -> usize {
        // SAFETY: the line's one owner calls this.
        let mut ring = unsafe { self.to_send.writer() };
        let count = ring.push(|room| {
            let length = room.len().min(from.len());
            room[..length].copy_from_slice(&from[..length]);
            length
        });
        // A transmitter that stands still makes no interrupt.
        critical_section::with(|_| self.transmit());
        count
    }
}

/// A UART in use. Each has one owner at a time: settings name a line once, and the board keeps the others for itself.
pub(crate) struct Line(&'static Uart);

impl Line {
    /// The UART of this number, at the speed of 25 MHz over `divisor`. What arrived before is forgotten.
    pub(crate) fn open(number: usize, divisor: u32) -> Self {
        let uart = &UARTS[number];
        uart.divisor.write(divisor);
        while uart.take(&mut [0; BUFFER_BYTES]) > 0 {}
        Self(uart)
    }
}

impl SerialLine for Line {
    /// The emulator's characters have no parity and no stop bit.
    fn take_flaws(&mut self) -> Flaws {
        let overrun = self.0.state.read() & RECEIVER_OVERRUN;
        self.0.state.write(overrun);
        Flaws { overruns: u32::from(overrun != 0), ..Flaws::default() }
    }
}

impl ErrorType for Line {
    type Error = Infallible;
}

impl Read for Line {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, Infallible> {
        poll_fn(|context| {
            self.0.arrived.register(context.waker());
            match self.0.take(into) {
                0 if !into.is_empty() => Poll::Pending,
                count => Poll::Ready(Ok(count)),
            }
        })
        .await
    }
}

impl Write for Line {
    async fn write(&mut self, from: &[u8]) -> Result<usize, Infallible> {
        poll_fn(|context| {
            self.0.room.register(context.waker());
            match self.0.put(from) {
                0 if !from.is_empty() => Poll::Pending,
                count => Poll::Ready(Ok(count)),
            }
        })
        .await
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        poll_fn(|context| {
            self.0.room.register(context.waker());
            if self.0.to_send.is_empty() { Poll::Ready(Ok(())) } else { Poll::Pending }
        })
        .await
    }
}
