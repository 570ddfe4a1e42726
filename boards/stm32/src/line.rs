//! An RS-485 line on a UART: DMA receives into a ring buffer and transmits from the caller's buffer.
//!
//! Receiving: every character raises an interrupt that wakes the port's task unless more are gathered, and DMA stores it.
//! Neither of embassy-stm32's receive paths is used. Its `BufferedUart` takes characters by interrupt, which loses them while the
//! chip stalls for a flash erase, and on the F4 it clears flags in a way that can lose one. Its ring buffer stops at a framing error
//! and discards unread data, and framing errors are common where a driver releases the bus. Here a corrupt character stays in the
//! buffer and is counted, and the frame's CRC reveals it.
//!
//! Transmitting: on the F7 and H7 the UART switches the transceiver's driver. On the F4 a pin does: on before the first character,
//! off in the interrupt after the last stop bit (TC, not TXE).

use core::future::poll_fn;
use core::task::Poll;

use embassy_embedded_hal::SetConfig;
use embassy_stm32::Peri;
use embassy_stm32::dma::{Channel, InterruptHandler, ReadableRingBuffer, Request};
use embassy_stm32::gpio::{Output, Pull};
use embassy_stm32::interrupt::typelevel::Binding;
use embassy_stm32::mode::Blocking;
use embassy_stm32::pac::dma::St;
use embassy_stm32::pac::usart::Usart;
use embassy_stm32::usart::{Config, ConfigError, DataBits, Instance, Parity, RxDma, StopBits, TxDma, Uart};
use embassy_time::Duration;
use embedded_io_async::{ErrorKind, ErrorType, Read, Write};
use mobgate::hal::{Flaws, OpenError, OpenErrorKind, Relay, SerialLine};
use mobgate::settings::{Driver, LineSettings, Parity as WireParity};
use mobgate_firmware::lines::Line;

use crate::registers;
use crate::shift::{Hardware, NO_FLAWS, SHIFTS, Shift};

/// Longest driver enable or disable time of the hardware, in sixteenths of a bit.
const DRIVER_SIXTEENTHS_MAX: u64 = 31;

/// Switches the driver off once pending characters have left, even if the write is cancelled.
struct Release(Usart);

impl Drop for Release {
    fn drop(&mut self) {
        // The interrupt modifies the same register.
        critical_section::with(|_| self.0.cr1().modify(|control| control.set_tcie(true)));
    }
}

pub(crate) struct UartLine {
    number: u8,
    setup: Uart<'static, Blocking>,
    hardware: Hardware,
    shift: &'static Shift,
    ring: ReadableRingBuffer<'static, u8>,
    transmit: Channel<'static>,
    request: Request,
    /// Mask of the data bits: with parity the UART stores the parity bit above seven data bits.
    mask: u8,
    /// The driver stays on after what is written.
    is_held: bool,
}

/// A line's DMA channels and requests.
pub(crate) struct Dma {
    receive: (Channel<'static>, Request, St),
    transmit: (Channel<'static>, Request),
}

impl Dma {
    /// The channels of UART `T`, with the stream that `receive` is. `interrupts` comes from `bind_interrupts!`.
    pub(crate) fn new<T: Instance, R: RxDma<T>, W: TxDma<T>>(
        receive: Peri<'static, R>,
        stream: St,
        transmit: Peri<'static, W>,
        interrupts: impl Binding<R::Interrupt, InterruptHandler<R>>
        + Binding<W::Interrupt, InterruptHandler<W>>
        + 'static,
    ) -> Self {
        let (receives, transmits) = (receive.request(), transmit.request());
        Self {
            receive: (Channel::new(receive, interrupts), receives, stream),
            transmit: (Channel::new(transmit, interrupts), transmits),
        }
    }
}

impl UartLine {
    /// Line `number`, whose interrupt must be bound to the [`LineInterrupt`](crate::shift::LineInterrupt) of that number. `setup` uses
    /// [`first_config`], which every UART supports. `driver` is the pin that switches the transceiver, unless `setup` has one.
    pub(crate) fn new(
        number: usize,
        setup: Result<Uart<'static, Blocking>, ConfigError>,
        uart: Usart,
        dma: Dma,
        driver: Option<Output<'static>>,
    ) -> Self {
        let shift = &SHIFTS[number];
        let ((channel, request, stream), from) = (dma.receive, registers::receive_address(uart));
        // SAFETY: the channel belongs to this line alone, the UART's register is always valid, and nobody but DMA writes the ring, all of
        // which may change while it is read.
        let mut ring = unsafe {
            ReadableRingBuffer::new(channel, request, from, &mut *shift.ring(), Default::default())
        };
        ring.start();
        let hardware = Hardware { uart, stream };
        shift.set_up(hardware, driver);
        let (transmit, request) = dma.transmit;
        let (setup, mask) = (setup.unwrap(), u8::MAX);
        Self { number: number as u8, setup, hardware, shift, ring, transmit, request, mask, is_held: false }
    }

    /// Discards what was received.
    fn clear(&mut self) {
        critical_section::with(|_| {
            loop {
                let place = self.hardware.position();
                self.ring.clear();
                // Nothing came in between: that is where the ring begins.
                if self.hardware.position() == place {
                    return self.shift.begin_at(place);
                }
            }
        });
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

impl Line for UartLine {
    /// DMA and interrupts feed the transmitter, and a character takes far longer than any task's poll. Only an F7 that saves its
    /// settings stalls: it breaks off the frame that is being passed on, as it cannot respond in time anyway.
    const NEVER_UNDERRUNS: bool = true;

    fn configure(&mut self, line: &LineSettings) -> Result<(), OpenError> {
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
        registers::complete_setup(self.hardware.uart, before as u8, after as u8);
        self.shift.configure(line.chars(1));
        self.shift.need(1);
        self.clear();
        self.take_flaws();
        Ok(())
    }

    fn relay_from(&mut self, from: usize, relay: Relay) -> bool {
        self.shift.relay(self.number.into(), from, relay)
    }
}

impl SerialLine for UartLine {
    /// Each character still interrupts, for its flaws.
    fn gather(&mut self, characters: usize) -> bool {
        self.shift.need(characters as u16);
        true
    }

    fn take_flaws(&mut self) -> Flaws {
        self.shift.flaws.lock(|cell| cell.replace(NO_FLAWS))
    }

    fn hold_driver(&mut self, on: bool) {
        if self.shift.has_pin() {
            self.is_held = on;
            // Off, if nothing is being sent.
            drop((!on).then(|| Release(self.hardware.uart)));
        }
    }

    fn end_relay(&mut self) -> Option<Relay> {
        self.shift.end_relay(self.number.into())
    }

    fn is_relayed(&self) -> bool {
        let relaying = &self.shift.relaying;
        relaying.is_running(self.number.into())
            || relaying.is_begun(self.number.into()) && self.shift.has_unread()
    }

    fn silence(&self) -> Duration {
        let is_silent = self.shift.relaying.is_silent(self.number.into());
        if is_silent { self.shift.character() } else { Duration::from_ticks(0) }
    }
}

impl ErrorType for UartLine {
    type Error = ErrorKind;
}

impl Read for UartLine {
    fn read(&mut self, into: &mut [u8]) -> impl Future<Output = Result<usize, ErrorKind>> {
        poll_fn(move |context| {
            self.shift.waker.register(context.waker());
            if critical_section::with(|section| self.shift.relaying.is_withheld(section, self.number.into()))
            {
                return Poll::Pending;
            }
            // The interrupt has counted each character. The ring's own look at the DMA takes a hundred instructions.
            if !self.shift.has_needed() {
                return Poll::Pending;
            }
            self.shift.need(1);
            loop {
                match self.ring.read(into) {
                    Ok((0, _)) => return Poll::Pending,
                    Ok((count, _)) => {
                        self.shift.note_read(count);
                        if self.mask != u8::MAX {
                            into.iter_mut().take(count).for_each(|byte| *byte &= self.mask);
                        }
                        return Poll::Ready(Ok(count));
                    }
                    // Overrun of the ring: its contents have no beginning and no end.
                    Err(_) => {
                        defmt::warn!("a line's characters were not read in time");
                        self.shift.count(Flaws { overruns: 1, ..NO_FLAWS });
                        self.clear();
                    }
                }
            }
        })
    }
}

impl Write for UartLine {
    async fn write(&mut self, from: &[u8]) -> Result<usize, ErrorKind> {
        if from.is_empty() {
            return Ok(0);
        }
        // What a relay has left comes first.
        poll_fn(|context| {
            self.shift.waker.register(context.waker());
            if self.shift.has_outgoing() { Poll::Pending } else { Poll::Ready(()) }
        })
        .await;
        let release = self.shift.has_pin().then(|| {
            critical_section::with(|_| self.hardware.uart.cr1().modify(|control| control.set_tcie(false)));
            self.shift.drive(true);
            Release(self.hardware.uart)
        });
        let to = registers::transmit_address(self.hardware.uart);
        let transfer = critical_section::with(|_| {
            // SAFETY: the channel belongs to this line; dropping the transfer stops it, so it does not outlive `from`.
            let transfer = unsafe { self.transmit.write(self.request, from, to, Default::default()) };
            if release.is_some() {
                // Now that the transmitter has a character: of one before, which ended meanwhile, the flag would end this one.
                registers::forget_transmitted(self.hardware.uart);
            }
            transfer
        });
        transfer.await;
        match self.is_held {
            true => core::mem::forget(release),
            false => drop(release),
        }
        Ok(from.len())
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        Ok(())
    }
}
