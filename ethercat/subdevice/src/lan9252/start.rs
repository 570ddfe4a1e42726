//! Sets the chip up, detects its resets, and recovers it.

use embassy_time::{Duration, Timer};
use embedded_hal_async::spi::SpiDevice;

use super::direction::Direction;
use super::registers::{BUSY, COMMAND, POLLS_MAX};
use super::{Health, InterruptPin, Lan9252};
use crate::esc::EscError;

const IRQ_CONFIG: u16 = 0x054;
const IRQ_STATUS: u16 = 0x058;
const IRQ_ENABLE: u16 = 0x05C;
const BYTE_TEST: u16 = 0x064;
const HARDWARE_CONFIG: u16 = 0x074;
const RESET_CONTROL: u16 = 0x1F8;

const TEST_PATTERN: u32 = 0x8765_4321;
const READY: u32 = 1 << 27;
const RESET_DIGITAL: u32 = 1;
const IRQ_FROM_ETHERCAT: u32 = 1;
/// Pin enabled; push-pull; active high.
const IRQ_ON: u32 = 0x100;
const IRQ_PUSH_PULL: u32 = 0x001;
const IRQ_HIGH: u32 = 0x010;

/// Timeout from a reset to the test pattern, and from there to READY.
const RESPONSE_LIMIT_MS: u64 = 100;
const READY_LIMIT_MS: u64 = 500;
const POLL_INTERVAL: Duration = Duration::from_millis(1);
/// Reads that confirm a wrong value.
const LOOKS: usize = 3;

impl<SPI: SpiDevice> Lan9252<SPI> {
    /// Ensures that the chip is set up before an access.
    pub(super) async fn ready(&mut self) -> Result<(), EscError> {
        match self.health {
            Health::Good => Ok(()),
            Health::Unknown => {
                self.wait_for_response().await?;
                self.reset().await?;
                self.set_up().await
            }
            Health::Suspect => self.recover().await,
            Health::Lost => {
                self.bring_back().await?;
                self.restarted = false;
                Ok(())
            }
        }
    }

    /// Whether the chip shows its test pattern.
    pub(super) async fn test_pattern(&mut self) -> Result<(), EscError> {
        match self.bus.read(BYTE_TEST).await? {
            TEST_PATTERN => Ok(()),
            other => Err(EscError::Absent(other)),
        }
    }

    /// Checks that the chip was not reset: a brown-out does so silently.
    pub(super) async fn check(&mut self) -> Result<(), EscError> {
        let mut pattern = 0;
        for _ in 0..LOOKS {
            pattern = self.bus.read(BYTE_TEST).await?;
            if pattern == TEST_PATTERN && self.bus.read(IRQ_CONFIG).await? == self.irq_config() {
                return Ok(());
            }
        }
        if pattern != TEST_PATTERN {
            return Err(EscError::Absent(pattern));
        }
        // Reported at once: waiting until it is ready may take longer than the caller should stay unaware.
        self.health = Health::Lost;
        Err(EscError::Restarted)
    }

    /// Recovers a misbehaving chip, if possible without a reset.
    async fn recover(&mut self) -> Result<(), EscError> {
        self.wait_for_response().await?;
        self.restarted |= !self.is_set_up().await?;
        self.bring_back().await?;
        // Reported once, after the set-up: until then it may happen again.
        if core::mem::take(&mut self.restarted) { Err(EscError::Restarted) } else { Ok(()) }
    }

    /// Sets the chip up once it is ready.
    async fn bring_back(&mut self) -> Result<(), EscError> {
        self.wait_for_response().await?;
        if !self.is_idle().await? {
            self.restarted = true;
            self.reset().await?;
        }
        self.set_up().await
    }

    async fn is_set_up(&mut self) -> Result<bool, EscError> {
        for _ in 0..LOOKS {
            if self.bus.read(IRQ_CONFIG).await? == self.irq_config() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Aborts unfinished work of the engines; returns whether all are usable.
    async fn is_idle(&mut self) -> Result<bool, EscError> {
        if self.reading.hangs() || self.writing.hangs() {
            return Ok(false);
        }
        for engine in [Direction::READ, Direction::WRITE] {
            match self.abort(engine).await {
                Err(EscError::Stuck(_)) => return Ok(false),
                outcome => outcome?,
            }
        }
        for _ in 0..POLLS_MAX {
            if self.bus.read(COMMAND).await? & BUSY == 0 {
                return Ok(true);
            }
        }
        Ok(false)
    }

    async fn reset(&mut self) -> Result<(), EscError> {
        self.bus.write(RESET_CONTROL, RESET_DIGITAL).await?;
        self.reading.reset();
        self.writing.reset();
        Timer::after(POLL_INTERVAL).await;
        self.wait_for_response().await?;
        self.try_engines().await
    }

    /// Whether the chip asserts its interrupt, by the register behind the pin.
    pub(super) async fn interrupts(&mut self) -> Result<bool, EscError> {
        Ok(self.bus.read(IRQ_STATUS).await? & IRQ_FROM_ETHERCAT != 0)
    }

    /// Waits for the test pattern and for READY.
    async fn wait_for_response(&mut self) -> Result<(), EscError> {
        let mut pattern = 0;
        for _ in 0..RESPONSE_LIMIT_MS {
            pattern = self.bus.read(BYTE_TEST).await?;
            if pattern == TEST_PATTERN {
                return self.wait_until_ready().await;
            }
            Timer::after(POLL_INTERVAL).await;
        }
        Err(EscError::Absent(pattern))
    }

    async fn wait_until_ready(&mut self) -> Result<(), EscError> {
        for _ in 0..READY_LIMIT_MS {
            if self.bus.read(HARDWARE_CONFIG).await? & READY != 0 {
                return Ok(());
            }
            Timer::after(POLL_INTERVAL).await;
        }
        Err(EscError::Stuck(HARDWARE_CONFIG))
    }

    /// Enables the interrupt pin. The successful read-back completes the set-up.
    async fn set_up(&mut self) -> Result<(), EscError> {
        self.bus.write(IRQ_CONFIG, self.irq_config()).await?;
        self.bus.write(IRQ_ENABLE, IRQ_FROM_ETHERCAT).await?;
        let config = self.bus.read(IRQ_CONFIG).await?;
        if config != self.irq_config() || self.bus.read(IRQ_ENABLE).await? != IRQ_FROM_ETHERCAT {
            return Err(EscError::Garbled(IRQ_CONFIG));
        }
        self.register_open = false;
        self.reading.aborted();
        self.writing.aborted();
        self.health = Health::Good;
        Ok(())
    }

    fn irq_config(&self) -> u32 {
        IRQ_ON
            | match self.wiring.interrupt {
                InterruptPin::High => IRQ_PUSH_PULL | IRQ_HIGH,
                InterruptPin::Low => IRQ_PUSH_PULL,
                InterruptPin::OpenDrain => 0,
            }
    }
}
