//! The SPI and the interrupt pin of an EtherCAT controller, which is simulated by a program of the host: a transaction goes there
//! and back by two pipes, `PATH.out` and `PATH.in`, when the command line has `spi=PATH`.
//!
//! What goes out is the number of bytes in two, the least significant first, and the bytes of the transaction; as many come back.
//! No bytes at all ask for the interrupt pin, which is the one byte that comes back. Everything on the board stands still
//! meanwhile.

use core::cell::RefCell;

use embassy_futures::yield_now;
use embassy_time::{Duration, Timer};
use embedded_hal::spi::{Error, ErrorKind, ErrorType, Operation};
use embedded_hal_async::spi::SpiDevice;
use heapless::Vec;

use crate::semihosting::{CommandLine, File, HostError};

/// Longest transaction: an image and what is around it.
const TRANSACTION_BYTES_MAX: usize = 1024;
const HEAD_BYTES: usize = 2;
/// Between two looks at the pin, which makes no interrupt here.
const PIN_INTERVAL: Duration = Duration::from_millis(1);
/// What is read where nobody answers.
const FLOATING: u8 = 0xff;

/// The wires to the controller.
pub(crate) struct Wires(RefCell<Option<(File, File)>>);

impl Wires {
    /// The wires that the command line names; without, they lead nowhere.
    ///
    /// # Panics
    /// When pipes that are named are not there.
    pub(crate) fn open() -> Self {
        let path = CommandLine::read();
        let pipes = path
            .value("spi")
            .map(|path| File::open_pipes(path).expect("pipes: see boards/qemu_mps2/emulate"));
        Self(RefCell::new(pipes))
    }

    fn exchange(&self, bytes: &mut Vec<u8, { HEAD_BYTES + TRANSACTION_BYTES_MAX }>) -> Result<(), HostError> {
        let (head, data) = bytes.split_at_mut(HEAD_BYTES);
        head.copy_from_slice(&(data.len() as u16).to_le_bytes());
        match &mut *self.0.borrow_mut() {
            Some((input, output)) => {
                output.put(bytes)?;
                input.take(&mut bytes[HEAD_BYTES..])
            }
            None => {
                data.fill(FLOATING);
                Ok(())
            }
        }
    }

    fn interrupt_is_high(&self) -> Result<bool, HostError> {
        let Some((input, output)) = &mut *self.0.borrow_mut() else { return Ok(false) };
        let mut level = [0];
        output.put(&[0; HEAD_BYTES])?;
        input.take(&mut level)?;
        Ok(level != [0])
    }

    /// Waits until the interrupt pin is high, or the host fails, as the next transaction will say.
    pub(crate) async fn interrupt(&self) {
        while let Ok(false) = self.interrupt_is_high() {
            Timer::after(PIN_INTERVAL).await;
        }
    }
}

/// The SPI, with the controller on its select line.
pub(crate) struct Spi<'w>(pub(crate) &'w Wires);

impl Error for HostError {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}

impl ErrorType for Spi<'_> {
    type Error = HostError;
}

impl SpiDevice for Spi<'_> {
    async fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), HostError> {
        let mut bytes = Vec::new();
        let _ = bytes.extend_from_slice(&[0; HEAD_BYTES]);
        for operation in &*operations {
            match operation {
                Operation::Write(from) => bytes.extend_from_slice(from),
                Operation::TransferInPlace(both) => bytes.extend_from_slice(both),
                Operation::Read(into) => bytes.resize(bytes.len() + into.len(), 0),
                // The driver of the controller has no use for these.
                Operation::Transfer(..) | Operation::DelayNs(_) => return Err(HostError),
            }
            .map_err(|_| HostError)?;
        }
        self.0.exchange(&mut bytes)?;
        let mut back = bytes.get(HEAD_BYTES..).unwrap_or_default();
        for operation in operations {
            let length = match operation {
                Operation::Read(into) | Operation::TransferInPlace(into) => {
                    into.copy_from_slice(&back[..into.len()]);
                    into.len()
                }
                Operation::Write(from) => from.len(),
                Operation::Transfer(..) | Operation::DelayNs(_) => 0,
            };
            back = &back[length..];
        }
        // Others have their turn: on a chip they had it during the transaction.
        yield_now().await;
        Ok(())
    }
}
