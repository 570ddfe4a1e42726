//! An RS-485 line on a UART: DMA receives into a ring buffer and transmits from the caller's buffer.
//!
//! Receiving: every character raises an interrupt that wakes the port's task, and DMA has stored it by then. Neither of
//! embassy-stm32's receive paths is used. Its `BufferedUart` takes characters by interrupt, which loses them while the chip stalls
//! for a flash erase, and on the F4 it clears flags in a way that can lose one. Its ring buffer stops at a framing error and
//! discards unread data, and framing errors are common where a driver releases the bus. Here a damaged character stays in the
//! buffer and is counted, and the frame's CRC reveals it.
//!
//! Transmitting: on the F7 and H7 the UART switches the transceiver's driver. On the F4 a pin does: on before the first character,
//! off in the interrupt after the last stop bit (TC, not TXE).

use core::cell::{Cell, RefCell};
use core::future::poll_fn;
use core::task::Poll;

use embassy_embedded_hal::SetConfig;
use embassy_stm32::Peri;
use embassy_stm32::dma::{Channel, InterruptHandler, ReadableRingBuffer, Request};
use embassy_stm32::gpio::{Output, Pull};
use embassy_stm32::interrupt::typelevel::{Binding, Handler, Interrupt};
use embassy_stm32::mode::Blocking;
use embassy_stm32::pac::usart::Usart;
use embassy_stm32::usart::{Config, ConfigError, DataBits, Instance, Parity, RxDma, StopBits, TxDma, Uart};
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::waitqueue::AtomicWaker;
use embedded_io_async::{ErrorKind, ErrorType, Read, Write};
use mobgate::hal::{Flaws, OpenError, OpenErrorKind, SerialLine};
use mobgate::settings::{Driver, LineSettings, Parity as WireParity};

use crate::registers;

/// Lines of a board, including its console.
pub(crate) const LINES_MAX: usize = 5;
/// Receive buffer: about 45 ms at 115200 baud, and twice that on the F7, which stalls while it saves settings.
pub(crate) const RING_BYTES: usize = if cfg!(feature = "f7") { 1024 } else { 512 };
/// Longest driver enable or disable time of the hardware, in sixteenths of a bit.
const DRIVER_SIXTEENTHS_MAX: u64 = 31;

const NO_FLAWS: Flaws = Flaws { parity: 0, framing: 0, overruns: 0 };

type Shared<T> = Mutex<CriticalSectionRawMutex, T>;

/// State shared by a line and its interrupt.
struct Shift {
    uart: Shared<Cell<Option<Usart>>>,
    waker: AtomicWaker,
    /// The pin that switches the transceiver's driver, if the UART cannot.
    driver: Shared<RefCell<Option<Output<'static>>>>,
    /// Flaws of received characters.
    flaws: Shared<Cell<Flaws>>,
}

static SHIFTS: [Shift; LINES_MAX] = [const {
    Shift {
        uart: Mutex::new(Cell::new(None)),
        waker: AtomicWaker::new(),
        driver: Mutex::new(RefCell::new(None)),
        flaws: Mutex::new(Cell::new(NO_FLAWS)),
    }
}; LINES_MAX];

/// The interrupt handler of line `N`'s UART.
pub(crate) struct LineInterrupt<const N: usize>;

impl<const N: usize, I: Interrupt> Handler<I> for LineInterrupt<N> {
    unsafe fn on_interrupt() {
        SHIFTS[N].on_interrupt();
    }
}

impl Shift {
    fn on_interrupt(&self) {
        let Some(uart) = self.uart.lock(Cell::get) else { return };
        if uart.cr1().read().tcie() && registers::transmitted(uart) {
            uart.cr1().modify(|control| control.set_tcie(false));
            self.drive(false);
        } else {
            self.count(registers::take_flaws(uart));
        }
        self.waker.wake();
    }

    fn count(&self, new: Flaws) {
        self.flaws.lock(|cell| {
            let Flaws { parity, framing, overruns } = cell.get();
            cell.set(Flaws {
                parity: parity.saturating_add(new.parity),
                framing: framing.saturating_add(new.framing),
                overruns: overruns.saturating_add(new.overruns),
            });
        });
    }

    fn drive(&self, on: bool) {
        self.driver.lock(|driver| {
            if let Some(pin) = driver.borrow_mut().as_mut() {
                pin.set_level(on.into());
            }
        });
    }

    fn has_pin(&self) -> bool {
        self.driver.lock(|driver| driver.borrow().is_some())
    }
}

/// Switches the driver off once pending characters have left, even if the write is cancelled.
struct Release(Usart);

impl Drop for Release {
    fn drop(&mut self) {
        // The interrupt modifies the same register.
        critical_section::with(|_| self.0.cr1().modify(|control| control.set_tcie(true)));
    }
}

/// A line.
pub(crate) struct Line {
    setup: Uart<'static, Blocking>,
    uart: Usart,
    shift: &'static Shift,
    ring: ReadableRingBuffer<'static, u8>,
    transmit: Channel<'static>,
    request: Request,
    /// Mask of the data bits: with parity the UART stores the parity bit above seven data bits.
    mask: u8,
}

/// A line's DMA channels and requests.
pub(crate) struct Dma {
    receive: (Channel<'static>, Request),
    transmit: (Channel<'static>, Request),
}

impl Dma {
    /// The channels of UART `T`. `interrupts` comes from `bind_interrupts!`.
    pub(crate) fn new<T: Instance, R: RxDma<T>, W: TxDma<T>>(
        receive: Peri<'static, R>,
        transmit: Peri<'static, W>,
        interrupts: impl Binding<R::Interrupt, InterruptHandler<R>>
        + Binding<W::Interrupt, InterruptHandler<W>>
        + Copy
        + 'static,
    ) -> Self {
        let (receives, transmits) = (receive.request(), transmit.request());
        Self {
            receive: (Channel::new(receive, interrupts), receives),
            transmit: (Channel::new(transmit, interrupts), transmits),
        }
    }
}

impl Line {
    /// Line `number`, whose interrupt must be bound to the [`LineInterrupt`] of that number. `setup` uses [`first_config`], which
    /// every UART supports. `driver` is the pin that switches the transceiver, unless `setup` has one.
    pub(crate) fn new(
        number: usize,
        setup: Result<Uart<'static, Blocking>, ConfigError>,
        uart: Usart,
        dma: Dma,
        driver: Option<Output<'static>>,
        ring: &'static mut [u8; RING_BYTES],
    ) -> Self {
        let shift = &SHIFTS[number];
        shift.uart.lock(|cell| cell.set(Some(uart)));
        shift.driver.lock(|cell| cell.replace(driver));
        let ((channel, request), from) = (dma.receive, registers::receive_address(uart));
        // SAFETY: channel and buffer belong to this line alone; the UART's register is always valid.
        let mut ring = unsafe { ReadableRingBuffer::new(channel, request, from, ring, Default::default()) };
        ring.start();
        let (transmit, request) = dma.transmit;
        Self { setup: setup.unwrap(), uart, shift, ring, transmit, request, mask: u8::MAX }
    }

    /// Sets speed, character format and driver times, and discards earlier input.
    pub(crate) fn configure(&mut self, line: &LineSettings) -> Result<(), OpenError> {
        let unsupported = |hint| OpenError::new(OpenErrorKind::Unsupported, hint);
        if line.driver == Driver::Rts {
            return Err(unsupported("the board switches the driver by itself: remove the word rts"));
        }
        let (before, after) = (sixteenths(line, line.driver_before), sixteenths(line, line.driver_after));
        let most = if self.shift.has_pin() { 0 } else { DRIVER_SIXTEENTHS_MAX };
        if before.max(after) > most {
            return Err(unsupported("driver-before and driver-after: less than two bits, and none on an F4"));
        }
        // A frame that is cut through pauses for a bit where its sender's crystal is slower. The driver must not release the bus there.
        let after = if after == 0 { DRIVER_SIXTEENTHS_MAX } else { after };
        self.mask = if line.data_bits == 7 { 0x7f } else { u8::MAX };
        self.setup.set_config(&config(line)).map_err(|_| unsupported("speed or character format"))?;
        registers::complete_setup(self.uart, before as u8, after as u8);
        self.ring.clear();
        self.take_flaws();
        Ok(())
    }
}

/// Initial configuration of a line's UART and pins.
pub(crate) fn first_config() -> Config {
    let mut config = Config::default();
    // An idle transceiver may leave the pin floating. `set_config` does not change pins.
    config.rx_pull = Pull::Up;
    config
}

/// `time` in sixteenths of a bit, rounded up.
fn sixteenths(line: &LineSettings, time: embassy_time::Duration) -> u64 {
    (time.as_micros() * 16 * u64::from(line.baud)).div_ceil(1_000_000)
}

fn config(line: &LineSettings) -> Config {
    let mut config = Config::default();
    config.baudrate = line.baud;
    config.data_bits = if line.data_bits == 7 { DataBits::DataBits7 } else { DataBits::DataBits8 };
    config.stop_bits = if line.stop_bits == 2 { StopBits::STOP2 } else { StopBits::STOP1 };
    config.parity = match line.parity {
        WireParity::None => Parity::ParityNone,
        WireParity::Even => Parity::ParityEven,
        WireParity::Odd => Parity::ParityOdd,
    };
    config
}

impl SerialLine for Line {
    fn take_flaws(&mut self) -> Flaws {
        self.shift.flaws.lock(|cell| cell.replace(NO_FLAWS))
    }
}

impl ErrorType for Line {
    type Error = ErrorKind;
}

impl Read for Line {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, ErrorKind> {
        let count = poll_fn(|context| {
            self.shift.waker.register(context.waker());
            loop {
                match self.ring.read(into) {
                    Ok((0, _)) => return Poll::Pending,
                    Ok((count, _)) => return Poll::Ready(count),
                    // Overrun of the ring: its contents have no beginning and no end.
                    Err(_) => {
                        defmt::warn!("a line's characters were not read in time");
                        self.shift.count(Flaws { overruns: 1, ..NO_FLAWS });
                        self.ring.clear();
                    }
                }
            }
        })
        .await;
        into.iter_mut().take(count).for_each(|byte| *byte &= self.mask);
        Ok(count)
    }
}

impl Write for Line {
    async fn write(&mut self, from: &[u8]) -> Result<usize, ErrorKind> {
        if from.is_empty() {
            return Ok(0);
        }
        let release = self.shift.has_pin().then(|| {
            critical_section::with(|_| self.uart.cr1().modify(|control| control.set_tcie(false)));
            registers::forget_transmitted(self.uart);
            self.shift.drive(true);
            Release(self.uart)
        });
        let to = registers::transmit_address(self.uart);
        // SAFETY: the channel belongs to this line; dropping the transfer stops it, so it does not outlive `from`.
        unsafe { self.transmit.write(self.request, from, to, Default::default()) }.await;
        drop(release);
        Ok(from.len())
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        Ok(())
    }
}
