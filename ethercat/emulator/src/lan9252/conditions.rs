//! Timing, faults and counters of an emulated LAN9252.

use crate::Nanos;

/// The chip's timing.
#[derive(Debug, Clone, Copy)]
pub struct Timing {
    /// The SPI clock.
    pub spi_hz: u64,
    /// Per transaction: select line, and the processor's gap to the next one.
    pub select_nanos: Nanos,
    /// One access to an ESC register.
    pub csr_nanos: Nanos,
    /// One double word between a FIFO and the ESC's memory.
    pub fifo_nanos: Nanos,
    /// From a reset to the test pattern.
    pub test_nanos: Nanos,
    /// From a reset to the READY bit.
    pub ready_nanos: Nanos,
}

impl Timing {
    /// SPI at 20 MHz, and a conservatively slow chip.
    pub const USUAL: Self = Self {
        spi_hz: 20_000_000,
        select_nanos: 300,
        csr_nanos: 800,
        fifo_nanos: 400,
        test_nanos: 1_000_000,
        ready_nanos: 20_000_000,
    };

    /// Nothing takes time, for use on the wall clock.
    pub const NONE: Self = Self {
        spi_hz: u64::MAX,
        select_nanos: 0,
        csr_nanos: 0,
        fifo_nanos: 0,
        test_nanos: 0,
        ready_nanos: 0,
    };
}

/// Faults between the processor and the chip.
#[derive(Debug, Clone, Copy, Default)]
pub struct SpiFaults {
    /// The probability of a bit flip per byte, in each direction.
    pub flipped: f64,
    /// The probability that a transaction fails in the processor.
    pub failed: f64,
}

/// Traffic counters.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Bytes on the SPI.
    pub bytes: u64,
    /// Transactions.
    pub selects: u64,
}
