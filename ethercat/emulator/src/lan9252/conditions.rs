//! What is set and counted at an emulated LAN9252: how fast it is, what fails, how much it was used.

use crate::Nanos;

/// How fast everything is.
#[derive(Debug, Clone, Copy)]
pub struct Timing {
    /// The SPI clock.
    pub spi_hz: u64,
    /// Around a transaction: the select line, and the processor's way to the next.
    pub select_nanos: Nanos,
    /// One access to a register of the ESC.
    pub csr_nanos: Nanos,
    /// One double word between a FIFO and the ESC's memory.
    pub fifo_nanos: Nanos,
    /// From a reset to the test pattern.
    pub test_nanos: Nanos,
    /// From a reset to the READY bit.
    pub ready_nanos: Nanos,
}

impl Timing {
    /// SPI at 20 MHz, and a chip that is slower than it needs to be.
    pub const USUAL: Self = Self {
        spi_hz: 20_000_000,
        select_nanos: 300,
        csr_nanos: 800,
        fifo_nanos: 400,
        test_nanos: 1_000_000,
        ready_nanos: 20_000_000,
    };

    /// Nothing takes time, for where the wall clock lets it pass.
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
    /// The probability that a bit of a byte is turned, in each direction.
    pub flipped: f64,
    /// The probability that a transaction fails in the processor.
    pub failed: f64,
}

/// What was counted since the last look.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Bytes on the SPI.
    pub bytes: u64,
    /// Transactions.
    pub selects: u64,
}
