//! The CMSDK UARTs, driven by interrupts through ring buffers.
//!
//! QEMU holds input back while a receiver is full, so no byte is ever lost: when the buffer is full, the receive interrupt is off
//! until the task has read. As with DMA and an idle-line interrupt, a task is woken once per piece of bytes, or when the lines have
//! been idle for a while. While its input is relayed to another UART, a task is woken at the end of the frame.

use core::convert::Infallible;
use core::future::poll_fn;
use core::sync::atomic::{AtomicU32, Ordering};
use core::task::Poll;

use critical_section::CriticalSection;
use embassy_sync::waitqueue::AtomicWaker;
use embassy_time::{Duration, TICK_HZ};
use embedded_io_async::{ErrorType, Read, Write};
use mobgate::hal::Relay;
use mobgate::hal::{Flaws, SerialLine};
use mobgate_board::relay::{Relaying, Step};

use crate::interrupts::{self, Interrupt};
use crate::measure::{self, Wait};
use crate::names;
use crate::register::Register;
use crate::ring::{RING_BYTES, Ring};
use crate::transmitter::{self, Transmitter};

/// Number of UARTs.
pub(crate) const COUNT: usize = interrupts::UARTS.len();
/// Input clock of the baud rate dividers.
pub(crate) const CLOCK_HZ: u32 = 25_000_000;
/// Lowest divisor that the hardware accepts.
pub(crate) const DIVISOR_MIN: u32 = 16;

/// A task is woken once this many bytes are available.
const PIECE_BYTES: usize = 64;
/// It is woken for fewer if no UART has received any for 250 us: two characters at 115200 baud. In timer cycles.
const IDLE_CYCLES: u32 = CLOCK_HZ / 4_000;
const IDLE_TIMER: usize = 0x4000_1000;
const IDLE_CONTROL: Register = Register::at(IDLE_TIMER, 0x0);
const IDLE_VALUE: Register = Register::at(IDLE_TIMER, 0x4);
const IDLE_RELOAD: Register = Register::at(IDLE_TIMER, 0x8);
const IDLE_CLEAR: Register = Register::at(IDLE_TIMER, 0xc);
const IDLE_START: u32 = 1 | 1 << 3;

const TRANSMITTER_FULL: u32 = 1;
const RECEIVER_FULL: u32 = 1 << 1;
/// Cleared by writing a 1.
const RECEIVER_OVERRUN: u32 = 1 << 3;
const TRANSMIT: u32 = 1;
const RECEIVE: u32 = 1 << 1;
const TRANSMIT_INTERRUPT: u32 = 1 << 2;
const RECEIVE_INTERRUPT: u32 = 1 << 3;

/// One at a time, because there is only one idle timer.
static RELAYING: Relaying = Relaying::new();

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
    received: Ring,
    to_send: Ring,
    arrived: AtomicWaker,
    wait: Wait,
    room: AtomicWaker,
    /// Longest pause in a frame that is being relayed, in timer cycles.
    pause: AtomicU32,
    /// Timeout of the idle timer for this UART; 0 while another UART owns the timer.
    idle: AtomicU32,
}

/// Starts all UARTs.
pub(crate) fn start() {
    for (uart, Interrupt(interrupt)) in UARTS.iter().zip(interrupts::UARTS) {
        uart.divisor.write(DIVISOR_MIN);
        uart.control.write(TRANSMIT | RECEIVE | RECEIVE_INTERRUPT);
        interrupts::enable(Interrupt(interrupt));
        interrupts::enable(Interrupt(interrupt + 1));
    }
    IDLE_RELOAD.write(IDLE_CYCLES);
    interrupts::enable(interrupts::TIMER_1);
}

/// The lines have been idle for a while.
pub(crate) extern "C" fn on_idle() {
    IDLE_CONTROL.write(0);
    IDLE_CLEAR.write(1);
    RELAYING.break_off();
    share_timer();
    wake_readers();
}

/// All interrupts have the same priority, so handlers are not interrupted.
fn in_interrupt<'a>() -> CriticalSection<'a> {
    // SAFETY: called by handlers only.
    unsafe { CriticalSection::new() }
}

/// Reserves the idle timer for UART `number`.
fn own_timer(number: usize) {
    UARTS.iter().for_each(|uart| uart.idle.store(0, Ordering::Relaxed));
    let uart = &UARTS[number];
    uart.idle.store(uart.pause.load(Ordering::Relaxed), Ordering::Relaxed);
    uart.restart_timer();
}

/// Shares the idle timer among all UARTs again.
fn share_timer() {
    UARTS.iter().for_each(|uart| uart.idle.store(IDLE_CYCLES, Ordering::Relaxed));
}

/// Wakes all readers, so that a busy line does not delay the end of another line's frame.
fn wake_readers() {
    UARTS.iter().filter(|uart| !uart.received.is_empty()).for_each(Uart::wake_reader);
}

pub(crate) extern "C" fn on_receive<const N: usize>() {
    measure::in_driver(|| {
        let uart = &UARTS[N];
        uart.interrupts.write(RECEIVE);
        let Some(byte) = uart.take_received() else { return };
        match measure::in_relay(|| RELAYING.step(in_interrupt(), N, byte)) {
            Step::Sent(to, byte) => UARTS[to].relay(byte),
            Step::Over => {
                share_timer();
                uart.wake_reader();
            }
            Step::None if uart.idle.load(Ordering::Relaxed) == 0 => uart.wake_reader(),
            Step::None if uart.received.len() >= PIECE_BYTES => wake_readers(),
            Step::None => {}
        }
    });
}

pub(crate) extern "C" fn on_transmit<const N: usize>() {
    measure::in_driver(|| {
        UARTS[N].interrupts.write(TRANSMIT);
        UARTS[N].transmit();
    });
}

impl Uart {
    const fn at(base: usize) -> Self {
        Self {
            data: Register::at(base, 0x0),
            state: Register::at(base, 0x4),
            control: Register::at(base, 0x8),
            interrupts: Register::at(base, 0xc),
            divisor: Register::at(base, 0x10),
            received: Ring::new(),
            to_send: Ring::new(),
            arrived: AtomicWaker::new(),
            wait: Wait::new(),
            room: AtomicWaker::new(),
            pause: AtomicU32::new(0),
            idle: AtomicU32::new(IDLE_CYCLES),
        }
    }

    /// Moves the receiver's byte into the buffer, if there is room.
    fn take_received(&self) -> Option<u8> {
        if self.state.read() & RECEIVER_FULL == 0 {
            return None;
        }
        if self.received.is_full() {
            self.control.write(self.control.read() & !RECEIVE_INTERRUPT);
            return None;
        }
        let byte = self.data.read() as u8;
        // SAFETY: one writer at a time: the receive interrupt, or a caller that masks interrupts.
        unsafe { self.received.push(byte) };
        self.restart_timer();
        Some(byte)
    }

    /// Restarts the idle timer.
    fn restart_timer(&self) {
        let idle = self.idle.load(Ordering::Relaxed);
        if idle > 0 {
            IDLE_VALUE.write(idle);
            IDLE_CONTROL.write(IDLE_START);
        }
    }

    fn wake_reader(&self) {
        self.wait.woken();
        self.arrived.wake();
    }

    /// Feeds the transmitter. In the interrupt, or with interrupts masked.
    fn transmit(&self) {
        if transmitter::transmit(self) {
            self.room.wake();
        }
    }

    /// Sends a byte after those in the buffer. Interrupts must be masked.
    #[inline(always)] // saves a call for each relayed byte
    fn relay(&self, byte: u8) {
        if self.to_send.is_empty() && self.state.read() & TRANSMITTER_FULL == 0 {
            self.data.write(byte.into());
        } else {
            self.relay_later(byte);
        }
    }

    #[cold]
    fn relay_later(&self, byte: u8) {
        // SAFETY: one writer at a time: while a relay sends here, the line's owner does not. The buffer holds any frame, so there
        // is room.
        unsafe { self.to_send.push(byte) };
        self.transmit();
    }

    /// Moves received bytes to `into`.
    fn take(&self, into: &mut [u8]) -> usize {
        // SAFETY: only the line's owner calls this.
        let count = unsafe { self.received.pop_into(into) };
        if count > 0 && self.control.read() & RECEIVE_INTERRUPT == 0 {
            critical_section::with(|_| {
                self.control.write(self.control.read() | RECEIVE_INTERRUPT);
                // A byte received while it was off raised no interrupt. No relay misses it: a relayed frame fits into the buffer.
                self.take_received();
            });
        }
        count
    }

    /// Moves bytes of `from` to the transmit buffer.
    fn put(&self, from: &[u8]) -> usize {
        // SAFETY: only the line's owner calls this.
        let count = from.iter().take_while(|byte| unsafe { self.to_send.push(**byte) }).count();
        // An idle transmitter raises no interrupt.
        critical_section::with(|_| measure::in_driver(|| self.transmit()));
        count
    }
}

impl Transmitter for Uart {
    fn is_full(&self) -> bool {
        self.state.read() & TRANSMITTER_FULL != 0
    }

    fn send(&self, byte: u8) {
        self.data.write(byte.into());
    }

    fn has_interrupt(&self) -> bool {
        self.control.read() & TRANSMIT_INTERRUPT != 0
    }

    fn set_interrupt(&self, on: bool) {
        let interrupt = if on { TRANSMIT_INTERRUPT } else { 0 };
        self.control.write(self.control.read() & !TRANSMIT_INTERRUPT | interrupt);
    }

    fn next(&self) -> Option<u8> {
        // SAFETY: one reader at a time: the transmit interrupt, or a caller that masks interrupts.
        unsafe { self.to_send.pop() }
    }

    fn is_idle(&self) -> bool {
        self.to_send.is_empty()
    }
}

/// A UART in use. Each has one owner at a time: settings use a line once, and the board keeps the others for itself.
pub(crate) struct Line(usize);

impl Line {
    /// Opens UART `number` at a speed of 25 MHz / `divisor`. Discards earlier input.
    pub(crate) fn open(number: usize, divisor: u32) -> Self {
        UARTS[number].divisor.write(divisor);
        while UARTS[number].take(&mut [0; RING_BYTES]) > 0 {}
        Self(number)
    }

    /// Sets the longest pause within a frame.
    pub(crate) fn pausing(self, pause: Duration) -> Self {
        let cycles = pause.as_ticks() * u64::from(CLOCK_HZ) / TICK_HZ;
        self.uart().pause.store(cycles as u32, Ordering::Relaxed);
        self
    }

    fn uart(&self) -> &'static Uart {
        &UARTS[self.0]
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        self.end_relay();
    }
}

impl SerialLine for Line {
    fn relay(&mut self, from: &str, mut relay: Relay) -> bool {
        let Some(from) = names::number(from) else { return false };
        critical_section::with(|section| {
            if !RELAYING.is_free() {
                return false;
            }
            // Characters received but not read go first.
            for nth in 0..UARTS[from].received.len() {
                // SAFETY: nobody reads meanwhile: interrupts are masked, and the line's task is not running.
                let byte = unsafe { UARTS[from].received.peek(nth) };
                byte.and_then(|byte| relay.step(byte)).into_iter().for_each(|byte| self.uart().relay(byte));
            }
            RELAYING.begin(section, relay, from, self.0);
            own_timer(from);
            true
        })
    }

    fn end_relay(&mut self) -> Option<Relay> {
        share_timer();
        RELAYING.end(self.0)
    }

    fn is_relayed(&self) -> bool {
        RELAYING.is_running(self.0) || RELAYING.is_begun(self.0) && !self.uart().received.is_empty()
    }

    fn silence(&self) -> Duration {
        let cycles = if RELAYING.is_silent(self.0) { self.uart().pause.load(Ordering::Relaxed) } else { 0 };
        Duration::from_ticks(u64::from(cycles) * TICK_HZ / u64::from(CLOCK_HZ))
    }

    /// The emulator's characters have neither parity nor stop bits.
    fn take_flaws(&mut self) -> Flaws {
        let uart = self.uart();
        let overrun = uart.state.read() & RECEIVER_OVERRUN;
        if overrun != 0 {
            uart.state.write(overrun);
        }
        Flaws { overruns: u32::from(overrun != 0), ..Flaws::default() }
    }
}

impl ErrorType for Line {
    type Error = Infallible;
}

impl Read for Line {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, Infallible> {
        self.uart().wait.begin();
        let read = poll_fn(|context| {
            self.uart().arrived.register(context.waker());
            if RELAYING.is_running(self.0) {
                return Poll::Pending;
            }
            match self.uart().take(into) {
                0 if !into.is_empty() => Poll::Pending,
                count => Poll::Ready(Ok(count)),
            }
        })
        .await;
        self.uart().wait.end(self.0);
        read
    }
}

impl Write for Line {
    async fn write(&mut self, from: &[u8]) -> Result<usize, Infallible> {
        measure::sends(self.0);
        poll_fn(|context| {
            self.uart().room.register(context.waker());
            match self.uart().put(from) {
                0 if !from.is_empty() => Poll::Pending,
                count => Poll::Ready(Ok(count)),
            }
        })
        .await
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        poll_fn(|context| {
            self.uart().room.register(context.waker());
            if self.uart().to_send.is_empty() { Poll::Ready(Ok(())) } else { Poll::Pending }
        })
        .await
    }
}
