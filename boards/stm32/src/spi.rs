//! The SPI to the EtherCAT controller: the processor itself transfers few bytes, and DMA many.

use embassy_stm32::mode::Async;
use embassy_stm32::spi::mode::Master;
use embassy_stm32::spi::{Error, Spi};
use embedded_hal_async::spi::{ErrorType, SpiBus};

/// The H7 keeps so many received bytes that nobody reads. To set up DMA and to take its end costs about 1800 instructions, more than the
/// time of these bytes, in which no other task runs, but interrupts do.
const DIRECT_BYTES_MAX: usize = 16;

pub(crate) struct Bus(pub(crate) Spi<'static, Async, Master>);

impl ErrorType for Bus {
    type Error = Error;
}

impl SpiBus for Bus {
    async fn read(&mut self, into: &mut [u8]) -> Result<(), Error> {
        if into.len() > DIRECT_BYTES_MAX { self.0.read(into).await } else { self.0.blocking_read(into) }
    }

    async fn write(&mut self, bytes: &[u8]) -> Result<(), Error> {
        if bytes.len() > DIRECT_BYTES_MAX { self.0.write(bytes).await } else { self.0.blocking_write(bytes) }
    }

    async fn transfer(&mut self, into: &mut [u8], bytes: &[u8]) -> Result<(), Error> {
        self.0.transfer(into, bytes).await
    }

    async fn transfer_in_place(&mut self, bytes: &mut [u8]) -> Result<(), Error> {
        self.0.transfer_in_place(bytes).await
    }

    async fn flush(&mut self) -> Result<(), Error> {
        // Every transfer has ended when it returns.
        Ok(())
    }
}
