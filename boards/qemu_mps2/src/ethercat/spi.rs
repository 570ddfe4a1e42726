//! The SPI and the interrupt pin of an EtherCAT controller simulated by a program on the host: transactions go through two pipes,
//! `PATH.out` and `PATH.in`, if the command line has `spi=PATH`.
//!
//! A request has the bytes of the transaction; the response has as many. An empty request asks for the interrupt pin, and the
//! response is one byte. The whole board stalls meanwhile.

use core::cell::RefCell;

use embassy_futures::yield_now;
use embassy_time::{Duration, Timer};
use embedded_hal::spi::{Error, ErrorKind, ErrorType, Operation};
use embedded_hal_async::spi::SpiDevice;
use heapless::Vec;

use super::pipes::{HEAD_BYTES, Pipes};
use crate::semihosting::{CommandLine, HostError};

/// Longest transaction: a process image and its overhead.
const TRANSACTION_BYTES_MAX: usize = 1024;
/// Poll interval of the pin, which raises no interrupt here.
const PIN_INTERVAL: Duration = Duration::from_millis(1);
/// Read if there is no controller.
const FLOATING: u8 = 0xff;

/// A transaction, behind room for the head of its message.
type Transaction = Vec<u8, { HEAD_BYTES + TRANSACTION_BYTES_MAX }>;

/// The wires to the controller.
pub(super) struct Wires(RefCell<Option<Pipes>>);

impl Wires {
    /// The wires given on the command line; unconnected if there are none.
    ///
    /// # Panics
    /// If the given pipes do not exist.
    pub(super) fn open() -> Self {
        let line = CommandLine::read();
        let path = line.words().find_map(|word| word.strip_prefix("spi="));
        Self(RefCell::new(path.map(|path| Pipes::open(path).expect("pipes: see boards/qemu_mps2/emulate"))))
    }

    /// Sends `bytes`, and fills `back` with the response.
    fn exchange(&self, bytes: &mut Transaction, back: &mut Transaction) -> Result<(), HostError> {
        // Both have the same capacity.
        let _ = back.resize(bytes.len() - HEAD_BYTES, FLOATING);
        match &mut *self.0.borrow_mut() {
            Some(pipes) => pipes.ask(bytes, back),
            None => Ok(()),
        }
    }

    fn interrupt_is_high(&self) -> Result<bool, HostError> {
        let Some(pipes) = &mut *self.0.borrow_mut() else { return Ok(false) };
        let mut level = [0];
        pipes.ask(&mut [0; HEAD_BYTES], &mut level)?;
        Ok(level != [0])
    }

    /// Waits until the interrupt pin is high. Also returns if the host fails, which the next transaction will report.
    pub(super) async fn interrupt(&self) {
        while let Ok(false) = self.interrupt_is_high() {
            Timer::after(PIN_INTERVAL).await;
        }
    }
}

/// The SPI, with the controller's chip select.
pub(super) struct Spi<'w>(pub(super) &'w Wires);

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
        let (mut bytes, mut back) = (Transaction::new(), Transaction::new());
        // It has room for the head.
        let _ = bytes.resize(HEAD_BYTES, 0);
        for operation in &*operations {
            match operation {
                Operation::Write(from) => bytes.extend_from_slice(from),
                Operation::TransferInPlace(both) => bytes.extend_from_slice(both),
                Operation::Read(into) => bytes.resize(bytes.len() + into.len(), 0),
                // The controller's driver does not use these.
                Operation::Transfer(..) | Operation::DelayNs(_) => return Err(HostError),
            }
            .map_err(|_| HostError)?;
        }
        self.0.exchange(&mut bytes, &mut back)?;
        let mut back = &back[..];
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
        // Lets other tasks run: on a chip they would have run during the transaction.
        yield_now().await;
        Ok(())
    }
}
