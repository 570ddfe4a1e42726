//! Error counters of a UART's driver. PTYs have none.

use std::os::fd::AsFd;

use mobgate::hal::Flaws;
use rustix::ioctl::{Getter, ioctl};

/// `struct serial_icounter_struct` of linux/serial.h: modem lines, characters, errors, and reserved words.
type Counts = [i32; 20];
/// Indices of the errors.
const FRAME: usize = 6;
const OVERRUN: usize = 7;
const PARITY: usize = 8;
const BREAK: usize = 9;
const BUFFER_OVERRUN: usize = 10;

/// The driver's counters at the last reading; `None` if there are none.
#[derive(Debug, Clone, Copy)]
pub(super) struct Receiver(Option<Counts>);

impl Receiver {
    /// Reads the counters of the newly opened `tty`.
    pub(super) fn new(tty: impl AsFd) -> Self {
        Self(counts(tty))
    }

    /// The errors since the last reading.
    pub(super) fn take_flaws(&mut self, tty: impl AsFd) -> Flaws {
        let Some(before) = self.0 else { return Flaws::default() };
        let Some(now) = counts(tty) else { return Flaws::default() };
        self.0 = Some(now);
        let since = |counter: usize| now[counter].wrapping_sub(before[counter]).unsigned_abs();
        let overruns = since(OVERRUN) + since(BUFFER_OVERRUN);
        Flaws { parity: since(PARITY), framing: since(FRAME) + since(BREAK), overruns }
    }
}

fn counts(tty: impl AsFd) -> Option<Counts> {
    // SAFETY: TIOCGICOUNT fills a `struct serial_icounter_struct`, which is twenty integers.
    unsafe { ioctl(tty, Getter::<{ libc::TIOCGICOUNT as _ }, Counts>::new()) }.ok()
}
