//! What a line shares with its UART's interrupt, and that interrupt: it wakes the port's task, and passes characters on to another line.
//!
//! DMA has stored a character, or is about to, when its interrupt comes; how many it has stored its counter tells, so none is passed
//! over when an interrupt comes late. While a relay runs, the interrupt gives the newest character, which is still in the UART's data
//! register as it may not be in memory yet, to the other UART's transmitter. Where that one is full, it takes the character later, in
//! its own interrupt, from the ring in which DMA has put it.

use core::cell::{Cell, RefCell};
use core::sync::atomic::{AtomicU8, AtomicU16, AtomicU32, Ordering};

use critical_section::CriticalSection;
use embassy_stm32::gpio::Output;
use embassy_stm32::interrupt::typelevel::{Handler, Interrupt};
use embassy_stm32::pac::dma::St;
use embassy_stm32::pac::usart::Usart;
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::waitqueue::AtomicWaker;
use embassy_time::Duration;
use mobgate::hal::{Flaws, Relay};
use mobgate_board::relay::{Relaying, Step};

use crate::registers;

/// Lines of a board, including its console.
pub(crate) const LINES_MAX: usize = 5;
/// Receive buffer: about 45 ms at 115200 baud, and twice that on the F7, which stalls while it saves settings.
pub(crate) const RING_BYTES: usize = if cfg!(feature = "f7") { 1024 } else { 512 };
/// Reads of the status for which a character may wait for DMA.
const DMA_READS_MAX: usize = 100;

pub(crate) const NO_FLAWS: Flaws = Flaws { parity: 0, framing: 0, overruns: 0 };

type Shared<T> = Mutex<CriticalSectionRawMutex, T>;

pub(crate) static SHIFTS: [Shift; LINES_MAX] = [const { Shift::new() }; LINES_MAX];

/// A line's UART, and the DMA stream that stores what it receives.
#[derive(Clone, Copy)]
pub(crate) struct Hardware {
    pub(crate) uart: Usart,
    pub(crate) stream: St,
}

impl Hardware {
    /// The place in the ring of the next character that DMA stores.
    pub(crate) fn position(&self) -> u16 {
        (RING_BYTES as u16 - self.stream.ndtr().read().ndt()) % RING_BYTES as u16
    }
}

/// Characters of another line that this one has to send: places in that line's ring.
#[derive(Clone, Copy)]
struct Outgoing {
    from: Option<&'static Shift>,
    next: u16,
    until: u16,
    /// The last of them, as it is to be sent.
    newest: u8,
}

/// State shared by a line and its interrupt. The ring comes last: what is near takes shorter instructions.
#[repr(C)]
pub(crate) struct Shift {
    hardware: Shared<Cell<Option<Hardware>>>,
    pub(crate) waker: AtomicWaker,
    /// The pin that switches the transceiver's driver, if the UART cannot.
    driver: Shared<RefCell<Option<Output<'static>>>>,
    /// Flaws of received characters.
    pub(crate) flaws: Shared<Cell<Flaws>>,
    /// The time of a character in microseconds.
    character_us: AtomicU32,
    /// Places in the ring: of the next character that `read` returns, of the next to be relayed, of the next that DMA stores.
    unread: AtomicU16,
    handed: AtomicU16,
    stored: AtomicU16,
    /// Unread characters that wake the reader.
    needed: AtomicU16,
    /// The relay of what this line receives.
    pub(crate) relaying: Relaying,
    outgoing: Shared<Cell<Outgoing>>,
    /// Written by DMA.
    ring: [AtomicU8; RING_BYTES],
}

/// The interrupt handler of line `N`'s UART.
pub(crate) struct LineInterrupt<const N: usize>;

impl<const N: usize, I: Interrupt> Handler<I> for LineInterrupt<N> {
    unsafe fn on_interrupt() {
        // SAFETY: all interrupts have the same priority, so handlers are not interrupted.
        SHIFTS[N].on_interrupt(unsafe { CriticalSection::new() }, N);
    }
}

/// The place behind `place`.
fn after(place: u16) -> u16 {
    (place + 1) % RING_BYTES as u16
}

impl Shift {
    const fn new() -> Self {
        Self {
            hardware: Mutex::new(Cell::new(None)),
            waker: AtomicWaker::new(),
            driver: Mutex::new(RefCell::new(None)),
            flaws: Mutex::new(Cell::new(NO_FLAWS)),
            character_us: AtomicU32::new(0),
            unread: AtomicU16::new(0),
            handed: AtomicU16::new(0),
            stored: AtomicU16::new(0),
            needed: AtomicU16::new(0),
            relaying: Relaying::new(),
            outgoing: Mutex::new(Cell::new(Outgoing { from: None, next: 0, until: 0, newest: 0 })),
            ring: [const { AtomicU8::new(0) }; RING_BYTES],
        }
    }

    /// Sets the hardware, and the pin of the driver.
    pub(crate) fn set_up(&self, hardware: Hardware, driver: Option<Output<'static>>) {
        self.hardware.lock(|cell| cell.set(Some(hardware)));
        self.driver.lock(|cell| cell.replace(driver));
    }

    /// Forgets what is to be sent; characters take so long from now on.
    pub(crate) fn configure(&self, character: Duration) {
        self.character_us.store(character.as_micros() as u32, Ordering::Relaxed);
        self.outgoing.lock(|cell| cell.set(Outgoing { next: cell.get().until, ..cell.get() }));
    }

    /// The ring, for DMA and for reading what it has stored.
    pub(crate) fn ring(&self) -> *mut [u8] {
        core::ptr::slice_from_raw_parts_mut(self.ring.as_ptr().cast_mut().cast(), RING_BYTES)
    }

    fn at(&self, place: u16) -> u8 {
        self.ring[usize::from(place) % RING_BYTES].load(Ordering::Relaxed)
    }

    /// The time of a character.
    pub(crate) fn character(&self) -> Duration {
        Duration::from_micros(self.character_us.load(Ordering::Relaxed).into())
    }

    /// `read` returned this many characters more.
    pub(crate) fn note_read(&self, count: usize) {
        let place = usize::from(self.unread.load(Ordering::Relaxed)) + count;
        self.unread.store((place % RING_BYTES) as u16, Ordering::Relaxed);
    }

    /// The next character that DMA stores, at `place`, is the next that `read` returns. Interrupts must be masked.
    pub(crate) fn begin_at(&self, place: u16) {
        self.unread.store(place, Ordering::Relaxed);
        self.stored.store(place, Ordering::Relaxed);
    }

    /// Whether `read` has not returned all that was received.
    pub(crate) fn has_unread(&self) -> bool {
        self.unread.load(Ordering::Relaxed) != self.stored.load(Ordering::Relaxed)
    }

    /// Whether there are as many unread characters as are [needed](Self::need).
    pub(crate) fn has_needed(&self) -> bool {
        let (unread, stored) = (self.unread.load(Ordering::Relaxed), self.stored.load(Ordering::Relaxed));
        let count = stored.wrapping_sub(unread) % RING_BYTES as u16;
        count > 0 && count >= self.needed.load(Ordering::Relaxed)
    }

    /// Fewer unread characters than these do not wake the reader.
    pub(crate) fn need(&self, characters: u16) {
        self.needed.store(characters, Ordering::Relaxed);
    }

    /// Whether characters of another line are to be sent.
    pub(crate) fn has_outgoing(&self) -> bool {
        self.outgoing.lock(|cell| cell.get().next != cell.get().until)
    }

    pub(crate) fn count(&self, new: Flaws) {
        if new == NO_FLAWS {
            return;
        }
        self.flaws.lock(|cell| {
            let Flaws { parity, framing, overruns } = cell.get();
            cell.set(Flaws {
                parity: parity.saturating_add(new.parity),
                framing: framing.saturating_add(new.framing),
                overruns: overruns.saturating_add(new.overruns),
            });
        });
    }

    /// Switches the transceiver's driver, if that is not the UART's.
    pub(crate) fn drive(&self, on: bool) {
        self.driver.lock(|driver| {
            if let Some(pin) = driver.borrow_mut().as_mut() {
                pin.set_level(on.into());
            }
        });
    }

    /// Whether a pin switches the driver; only the F4's UARTs cannot.
    pub(crate) fn has_pin(&self) -> bool {
        cfg!(feature = "f4") && self.driver.lock(|driver| driver.borrow().is_some())
    }

    fn on_interrupt(&self, section: CriticalSection, number: usize) {
        let Some(hardware) = self.hardware.borrow(section).get() else { return };
        let uart = hardware.uart;
        let (enabled, state) = (uart.cr1().read(), registers::state(uart));
        // DMA takes the character within some cycles. Until then its counter does not include it.
        let (mut now, mut reads) = (state, 0);
        while now.rxne() && reads < DMA_READS_MAX {
            (now, reads) = (registers::state(uart), reads + 1);
        }
        self.count(registers::take_flaws(uart, state));
        if cfg!(feature = "f4") && enabled.tcie() && state.tc() {
            uart.cr1().modify(|control| control.set_tcie(false));
            self.drive(false);
        }
        if enabled.txeie() {
            self.transmit(section);
        }
        let (before, stored) = (self.stored.load(Ordering::Relaxed), hardware.position());
        self.stored.store(stored, Ordering::Relaxed);
        if stored != before && self.relaying.is_begun(number) {
            let newest = self.relaying.is_running(number).then(|| registers::received(uart));
            self.hand_on(section, number, newest);
        }
        if enabled.idleie() && state.idle() {
            self.relaying.break_off();
            uart.cr1().modify(|control| control.set_idleie(false));
        }
        if self.has_needed() && !self.relaying.is_withheld(section, number) {
            self.waker.wake();
        }
    }

    /// Relays what DMA has stored. `newest`: the last character, if it may not be in memory yet.
    fn hand_on(&self, section: CriticalSection, number: usize, newest: Option<u8>) {
        let stored = self.stored.load(Ordering::Relaxed);
        loop {
            let place = self.handed.load(Ordering::Relaxed);
            if place == stored {
                return;
            }
            let next = after(place);
            self.handed.store(next, Ordering::Relaxed);
            let byte = newest.filter(|_| next == stored).unwrap_or_else(|| self.at(place));
            let Some(byte) = self.step(section, number, byte) else { return };
            if let Some(to) = SHIFTS.get(self.relaying.to()) {
                let cell = to.outgoing.borrow(section);
                cell.set(Outgoing { until: next, newest: byte, ..cell.get() });
                to.transmit(section);
            }
        }
    }

    /// What to send for a character that was received.
    #[inline(never)] // its instructions are counted apart from the driver's
    fn step(&self, section: CriticalSection, number: usize, byte: u8) -> Option<u8> {
        match self.relaying.step(section, number, byte) {
            Step::Sent(_, byte) => Some(byte),
            Step::Over | Step::None => None,
        }
    }

    /// Sends what was handed on to this line as far as the transmitter takes it; its interrupt is on while something is left.
    fn transmit(&self, section: CriticalSection) {
        let cell = self.outgoing.borrow(section);
        let mut outgoing = cell.get();
        let (Some(Hardware { uart, .. }), Some(from)) = (self.hardware.borrow(section).get(), outgoing.from)
        else {
            return;
        };
        while outgoing.next != outgoing.until && registers::state(uart).txe() {
            let place = outgoing.next;
            outgoing.next = after(place);
            let is_newest = outgoing.next == outgoing.until;
            registers::send(uart, if is_newest { outgoing.newest } else { from.at(place) });
        }
        cell.set(outgoing);
        let waits = outgoing.next != outgoing.until;
        if uart.cr1().read().txeie() != waits {
            uart.cr1().modify(|control| control.set_txeie(waits));
            // A write may wait for the end.
            self.waker.wake();
        }
    }

    /// Begins to relay what the line `from` receives to this line, which is `number`: what it has not read first. Returns whether that
    /// is possible.
    pub(crate) fn relay(&self, number: usize, from: usize, relay: Relay) -> bool {
        let Some(source) = SHIFTS.get(from) else { return false };
        // Where this line is slower by more, the ring would come round while it still sends.
        let keeps_up =
            2 * self.character_us.load(Ordering::Relaxed) <= 3 * source.character_us.load(Ordering::Relaxed);
        critical_section::with(|section| {
            let Some(Hardware { uart, .. }) = source.hardware.borrow(section).get() else { return false };
            // A silence that has begun raises no interrupt when it is long enough.
            if !source.relaying.is_free() || !keeps_up || registers::state(uart).idle() {
                return false;
            }
            let next = source.unread.load(Ordering::Relaxed);
            source.handed.store(next, Ordering::Relaxed);
            self.outgoing.borrow(section).set(Outgoing { from: Some(source), next, until: next, newest: 0 });
            source.relaying.begin(section, relay, from, number);
            uart.cr1().modify(|control| control.set_idleie(true));
            source.hand_on(section, from, None);
            true
        })
    }

    /// Ends the relay to this line, which is `number`, and returns what is left of it.
    pub(crate) fn end_relay(&self, number: usize) -> Option<Relay> {
        self.outgoing.lock(Cell::get).from?.relaying.end(number)
    }
}
