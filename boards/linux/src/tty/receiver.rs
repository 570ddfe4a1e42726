//! What a UART's driver counts of bad characters. PTYs count nothing.

use std::os::fd::AsFd;

use mobgate::hal::Flaws;
use rustix::ioctl::{Getter, ioctl};

/// `struct serial_icounter_struct` of linux/serial.h: modem lines, characters, errors, and room for more.
type Counts = [i32; 20];
/// Where in it the errors are.
const FRAME: usize = 6;
const OVERRUN: usize = 7;
const PARITY: usize = 8;
const BREAK: usize = 9;
const BUFFER_OVERRUN: usize = 10;

/// The driver's counters at the last look; `None` where there are none.
#[derive(Debug, Clone, Copy)]
pub(super) struct Receiver(Option<Counts>);

impl Receiver {
    /// The counters of `tty`, which has just been opened.
    pub(super) fn new(tty: impl AsFd) -> Self {
        Self(counts(tty))
    }

    /// What has been added since the last look.
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
    // SAFETY: TIOCGICOUNT fills in a `struct serial_icounter_struct`, which is twenty integers.
    unsafe { ioctl(tty, Getter::<{ libc::TIOCGICOUNT as _ }, Counts>::new()) }.ok()
}
