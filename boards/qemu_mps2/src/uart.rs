//! The CMSDK UARTs, driven by interrupts through ring buffers.
//!
//! QEMU holds back what a full receiver cannot take, so no byte is ever lost: when the buffer is full, the receiver's interrupt
//! is off until the task has read. As with a DMA channel and an idle line's interrupt, a task is not woken for each byte but for
//! a piece, or when nothing has come for a while. While another UART sends what comes, it is woken when the frame is there.

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

use crate::interrupts::{self, Interrupt};
use crate::measure::{self, Wait};
use crate::names;
use crate::register::Register;
use crate::relay::{self, Step};
use crate::ring::{RING_BYTES, Ring};
use crate::transmitter::{self, Transmitter};

/// UARTs of the machine.
pub(crate) const COUNT: usize = interrupts::UARTS.len();
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
    received: Ring,
    to_send: Ring,
    arrived: AtomicWaker,
    wait: Wait,
    room: AtomicWaker,
    /// The longest pause in a frame that is being relayed, in cycles of the timer.
    pause: AtomicU32,
    /// The pause after which the idle timer tells, or 0: it is another UART's now.
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

/// Nothing has come for a while.
pub(crate) extern "C" fn on_idle() {
    IDLE_CONTROL.write(0);
    IDLE_CLEAR.write(1);
    relay::break_off();
    share_timer();
    wake_readers();
}

/// All interrupts have one priority: a handler is not interrupted.
fn in_interrupt<'a>() -> CriticalSection<'a> {
    // SAFETY: this is called by handlers only.
    unsafe { CriticalSection::new() }
}

/// Lets UART `number` have the idle timer for itself.
fn own_timer(number: usize) {
    UARTS.iter().for_each(|uart| uart.idle.store(0, Ordering::Relaxed));
    let uart = &UARTS[number];
    uart.idle.store(uart.pause.load(Ordering::Relaxed), Ordering::Relaxed);
    uart.restart_timer();
}

/// Lets all UARTs have it again.
fn share_timer() {
    UARTS.iter().for_each(|uart| uart.idle.store(IDLE_CYCLES, Ordering::Relaxed));
}

/// Wakes all at once, so that a busy line does not keep the end of another's frame waiting.
fn wake_readers() {
    UARTS.iter().filter(|uart| !uart.received.is_empty()).for_each(Uart::wake_reader);
}

pub(crate) extern "C" fn on_receive<const N: usize>() {
    measure::in_driver(|| {
        let uart = &UARTS[N];
        uart.interrupts.write(RECEIVE);
        let Some(byte) = uart.take_received() else { return };
        match measure::in_relay(|| relay::step(in_interrupt(), N, byte)) {
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

    /// Moves the byte that the receiver has into the buffer, if there is room.
    fn take_received(&self) -> Option<u8> {
        if self.state.read() & RECEIVER_FULL == 0 {
            return None;
        }
        if self.received.is_full() {
            self.control.write(self.control.read() & !RECEIVE_INTERRUPT);
            return None;
        }
        let byte = self.data.read() as u8;
        // SAFETY: there is one writer at a time: the receive interrupt, or who masks interrupts.
        unsafe { self.received.push(byte) };
        self.restart_timer();
        Some(byte)
    }

    /// Lets the idle timer run from now on.
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

    /// Gives the transmitter what it takes. By the interrupt, or with interrupts masked.
    fn transmit(&self) {
        if transmitter::transmit(self) {
            self.room.wake();
        }
    }

    /// Sends a byte behind those that wait. With interrupts masked.
    #[inline(always)] // one less call for each byte that is relayed
    fn relay(&self, byte: u8) {
        if self.to_send.is_empty() && self.state.read() & TRANSMITTER_FULL == 0 {
            self.data.write(byte.into());
        } else {
            self.relay_later(byte);
        }
    }

    #[cold]
    fn relay_later(&self, byte: u8) {
        // SAFETY: there is one writer at a time: while a relay sends here, the line's owner does not.
        // There is room: it is longer than any frame.
        unsafe { self.to_send.push(byte) };
        self.transmit();
    }

    /// Moves received bytes to `into`.
    fn take(&self, into: &mut [u8]) -> usize {
        // SAFETY: the line's one owner calls this.
        let count = unsafe { self.received.pop_into(into) };
        if count > 0 && self.control.read() & RECEIVE_INTERRUPT == 0 {
            critical_section::with(|_| {
                self.control.write(self.control.read() | RECEIVE_INTERRUPT);
                // What came while it was off has made no interrupt. It is not relayed: a frame has more room.
                self.take_received();
            });
        }
        count
    }

    /// Moves bytes of `from` to the transmitter's buffer.
    fn put(&self, from: &[u8]) -> usize {
        // SAFETY: the line's one owner calls this.
        let count = from.iter().take_while(|byte| unsafe { self.to_send.push(**byte) }).count();
        // A transmitter that stands still makes no interrupt.
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
        // SAFETY: there is one reader at a time: the transmit interrupt, or who masks interrupts.
        unsafe { self.to_send.pop() }
    }

    fn is_idle(&self) -> bool {
        self.to_send.is_empty()
    }
}

/// A UART in use. Each has one owner at a time: settings name a line once, and the board keeps the others for itself.
pub(crate) struct Line(usize);

impl Line {
    /// The UART of this number, at the speed of 25 MHz over `divisor`. What arrived before is forgotten.
    pub(crate) fn open(number: usize, divisor: u32) -> Self {
        UARTS[number].divisor.write(divisor);
        while UARTS[number].take(&mut [0; RING_BYTES]) > 0 {}
        Self(number)
    }

    /// The line, whose frames may have pauses up to `pause`.
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
            if !relay::is_free() {
                return false;
            }
            // What has come and was not read goes first.
            for nth in 0..UARTS[from].received.len() {
                // SAFETY: nobody reads meanwhile, with interrupts masked and in no task of that line.
                let byte = unsafe { UARTS[from].received.peek(nth) };
                byte.and_then(|byte| relay.step(byte)).into_iter().for_each(|byte| self.uart().relay(byte));
            }
            relay::begin(section, relay, from, self.0);
            own_timer(from);
            true
        })
    }

    fn end_relay(&mut self) -> Option<Relay> {
        share_timer();
        relay::end(self.0)
    }

    fn is_relayed(&self) -> bool {
        relay::is_running(self.0) || relay::is_begun(self.0) && !self.uart().received.is_empty()
    }

    fn silence(&self) -> Duration {
        let cycles = if relay::is_silent(self.0) { self.uart().pause.load(Ordering::Relaxed) } else { 0 };
        Duration::from_ticks(u64::from(cycles) * TICK_HZ / u64::from(CLOCK_HZ))
    }

    /// The emulator's characters have no parity and no stop bit.
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
            if relay::is_running(self.0) {
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
