//! The LAN9252 on SPI: registers through one engine of the chip, process data through two FIFOs.
//!
//! An access below 1000h uses the register engine (`registers`), with at most four bytes at a time; one above streams through a
//! FIFO (`fifo`) in few, long transactions (`bus`). If the chip misbehaves, the access fails, and the next one first recovers the
//! chip (`start`): if that took a reset, it fails with [`EscError::Restarted`], as all the caller's settings are lost.
//!
//! # Corrupt transfers
//!
//! The SPI has no checksum. The command registers are read back after every access, which detects a wrong address or length, and
//! lost or extra bytes ([`EscError::Garbled`]). Register values are read twice, which detects any corruption. Bit flips in process
//! data are *not* detected. On an unreliable line, read outputs with [`read_agreed`](crate::esc::read_agreed), or let the
//! MainDevice add a sequence number or checksum.

mod bus;
mod direction;
mod fifo;
mod registers;
mod start;

use embassy_time::{Duration, Instant};
use embedded_hal_async::spi::SpiDevice;

use crate::esc::{CycleCost, Esc, EscError};
use crate::registers::Events;
use bus::Bus;
use direction::Direction;

/// The first address of process data memory.
const PROCESS_RAM: u16 = 0x1000;
/// The AL event request.
const AL_EVENT: u16 = 0x0220;
/// The fastest clock for reads without a pause.
const READ_HZ_MAX: u32 = 30_000_000;
/// Interval of checks that the chip has not been reset.
const CHECK_INTERVAL: Duration = Duration::from_millis(20);

/// How the chip is wired.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wiring {
    /// The SPI clock. Above 30 MHz, reads need a dummy byte before their data.
    pub spi_hz: u32,
    /// Overhead of a chip select, including the processor's gap to the next one.
    pub select_ns: u32,
    /// Mode of the interrupt pin.
    pub interrupt: InterruptPin,
}

/// Mode of the chip's interrupt pin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InterruptPin {
    /// Push-pull, active high. Needs a pull-down on the board, as the pin floats during reset.
    High,
    /// Push-pull, active low; needs a pull-up.
    Low,
    /// Open drain, active low; needs a pull-up, and may share the line.
    OpenDrain,
}

impl Default for Wiring {
    /// 20 MHz, one microsecond per chip select, interrupt active high.
    fn default() -> Self {
        Self { spi_hz: 20_000_000, select_ns: 1_000, interrupt: InterruptPin::High }
    }
}

impl Wiring {
    const fn is_fast(self) -> bool {
        self.spi_hz > READ_HZ_MAX
    }
}

/// Faults since the driver was created, for diagnosis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Incidents {
    /// Register accesses repeated because of a wrong read-back.
    pub repeated: u32,
    /// Accesses failed because of a wrong read-back.
    pub garbled: u32,
    /// Accesses that exceeded the chip's timeout.
    pub stuck: u32,
    /// How often the chip was set up again.
    pub restarts: u32,
}

/// The known condition of the chip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Health {
    /// Not accessed yet.
    Unknown,
    /// It misbehaved.
    Suspect,
    /// It has lost its settings, and the caller knows.
    Lost,
    /// It is set up.
    Good,
}

/// The driver.
pub struct Lan9252<SPI> {
    bus: Bus<SPI>,
    wiring: Wiring,
    health: Health,
    /// The chip has lost its settings, and the caller does not know yet.
    restarted: bool,
    checked: Instant,
    /// A register access is unfinished: its future was dropped, or it failed.
    register_open: bool,
    reading: Direction,
    writing: Direction,
    incidents: Incidents,
}

impl<SPI: SpiDevice> Lan9252<SPI> {
    /// A driver of the chip on `spi`. The first access resets the chip and sets it up.
    pub fn new(spi: SPI, wiring: Wiring) -> Self {
        Self {
            bus: Bus::new(spi, wiring.is_fast()),
            wiring,
            health: Health::Unknown,
            restarted: false,
            checked: Instant::MIN,
            register_open: false,
            reading: Direction::READ,
            writing: Direction::WRITE,
            incidents: Incidents::default(),
        }
    }

    /// Faults so far.
    pub fn incidents(&self) -> Incidents {
        self.incidents
    }

    /// Records the outcome of an access.
    fn noted<T>(&mut self, outcome: Result<T, EscError>) -> Result<T, EscError> {
        match outcome {
            Ok(_) | Err(EscError::Bus | EscError::Absent(_) | EscError::Unreachable(_)) => {}
            Err(EscError::Garbled(_)) => self.incidents.garbled += 1,
            Err(EscError::Stuck(_)) => self.incidents.stuck += 1,
            Err(EscError::Restarted) => self.incidents.restarts += 1,
        }
        // A chip that was never set up stays unknown, and is reset once it responds.
        let fresh = matches!(outcome, Ok(_) | Err(EscError::Restarted));
        if self.health == Health::Good && !fresh {
            self.health = Health::Suspect;
        }
        outcome
    }

    async fn try_read(&mut self, address: u16, into: &mut [u8]) -> Result<(), EscError> {
        self.ready().await?;
        let below = usize::from(PROCESS_RAM.saturating_sub(address)).min(into.len());
        let (registers, memory) = into.split_at_mut(below);
        self.read_registers(address, registers).await?;
        self.read_memory(address.wrapping_add(below as u16), memory).await
    }

    async fn try_write(&mut self, address: u16, bytes: &[u8]) -> Result<(), EscError> {
        self.ready().await?;
        let below = usize::from(PROCESS_RAM.saturating_sub(address)).min(bytes.len());
        let (registers, memory) = bytes.split_at(below);
        self.write_registers(address, registers).await?;
        self.write_memory(address.wrapping_add(below as u16), memory).await
    }

    async fn try_events(&mut self) -> Result<u32, EscError> {
        self.checked().await?;
        self.read_register(AL_EVENT, 4).await
    }

    /// Ensures that the chip is set up, and periodically checks that it still is.
    async fn checked(&mut self) -> Result<(), EscError> {
        self.ready().await?;
        if self.checked.elapsed() >= CHECK_INTERVAL {
            self.check().await?;
            self.checked = Instant::now();
        }
        Ok(())
    }

    async fn try_outputs(&mut self, address: u16, into: &mut [u8]) -> Result<u32, EscError> {
        self.checked().await?;
        let mut came = 0;
        if self.can_read_with_events(address, into.len()) {
            match self.read_with_events(address, into).await? {
                Some(events) => return Ok(events),
                None => {
                    self.incidents.repeated += 1;
                    // The failed read may have cleared the event; the outputs are still there.
                    came = Events::OUTPUTS_WRITTEN.0;
                }
            }
        }
        let events = self.read_register(AL_EVENT, 4).await? | came;
        if Events(events).any(Events::OUTPUTS_WRITTEN) {
            self.read_memory(address, into).await?;
        }
        Ok(events)
    }

    async fn try_asks(&mut self) -> Result<bool, EscError> {
        self.ready().await?;
        self.interrupts().await
    }
}

impl<SPI: SpiDevice> Esc for Lan9252<SPI> {
    async fn read(&mut self, address: u16, into: &mut [u8]) -> Result<(), EscError> {
        let outcome = self.try_read(address, into).await;
        self.noted(outcome)
    }

    async fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), EscError> {
        let outcome = self.try_write(address, bytes).await;
        self.noted(outcome)
    }

    async fn events(&mut self) -> Result<u32, EscError> {
        let outcome = self.try_events().await;
        self.noted(outcome)
    }

    async fn outputs(&mut self, address: u16, into: &mut [u8]) -> Result<u32, EscError> {
        let outcome = self.try_outputs(address, into).await;
        self.noted(outcome)
    }

    async fn asks(&mut self) -> Result<bool, EscError> {
        let outcome = self.try_asks().await;
        self.noted(outcome)
    }

    fn cycle_cost(&self, outputs: u16, inputs: u16, proves: bool) -> CycleCost {
        const HEAD: u32 = 3;
        let words = |bytes: u16| u32::from(bytes.next_multiple_of(4));
        let read_head = HEAD + u32::from(self.wiring.is_fast());
        // Address and command; the data; and the completion check.
        let (write_memory, read_memory) =
            (HEAD + 8 + HEAD + words(inputs) + read_head + 8, HEAD + 8 + 2 * read_head + words(outputs) + 8);
        // Events are read with the outputs: a command, two registers, a second read of one; then the interrupt status.
        let (events, again) = (4 + 8 + 2 * (read_head + 4), if proves { 1 } else { 0 });
        CycleCost {
            bytes: events + (1 + again) * read_memory + write_memory,
            selects: 8 + 3 * again,
            clock_hz: self.wiring.spi_hz,
            select_ns: self.wiring.select_ns,
        }
    }

    async fn look(&mut self) -> Result<(), EscError> {
        self.test_pattern().await
    }
}
