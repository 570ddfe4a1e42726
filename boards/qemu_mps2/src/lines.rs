//! The Modbus lines: `uart1` to `uart3`. UART 0 is the console, UART 4 reports figures.

use embassy_time::Duration;
use mobgate::hal::{OpenError, OpenErrorKind, SerialHost};
use mobgate::settings::{Driver, LineSettings};

use crate::names::number;
use crate::uart::{CLOCK_HZ, DIVISOR_MIN, Line};

/// The console's UART.
pub(crate) const CONSOLE: usize = 0;
/// The UART that reports figures.
pub(crate) const FIGURES: usize = 4;
/// QEMU does not pace bytes: input may pause at any byte while the host is busy.
const READ_JITTER: Duration = Duration::from_millis(50);

/// Opens the lines.
pub(crate) struct Lines;

impl SerialHost for Lines {
    type Line<'a> = Line;

    async fn open(&mut self, device: &str, line: &LineSettings) -> Result<Line, OpenError> {
        let refused = |kind, hint| Err(OpenError::new(kind, hint));
        let Some(number) = number(device) else {
            return refused(OpenErrorKind::NotFound, "this board has uart1, uart2 and uart3");
        };
        if line.driver != Driver::Automatic {
            return refused(
                OpenErrorKind::Unsupported,
                "its lines have no transceivers: remove rs485 or rts",
            );
        }
        // The core computes with the length of parity and stop bits; the emulator carries bytes only.
        match CLOCK_HZ / line.baud {
            divisor @ DIVISOR_MIN.. => Ok(Line::open(number, divisor).pausing(line.t1_5() + READ_JITTER)),
            _ => refused(OpenErrorKind::Unsupported, "at most 1562500 baud"),
        }
    }

    fn read_jitter(&self) -> Duration {
        READ_JITTER
    }
}
