//! The engine that accesses ESC registers: at most four bytes, suitably aligned.

use embedded_hal_async::spi::SpiDevice;

use super::Lan9252;
use crate::esc::EscError;

/// Data register, directly before the command register.
pub(super) const DATA: u16 = 0x300;
pub(super) const COMMAND: u16 = 0x304;
pub(super) const BUSY: u32 = 1 << 31;
pub(super) const READ: u32 = 1 << 30;
/// Polls of the command register until the engine counts as stuck; each takes some microseconds.
pub(super) const POLLS_MAX: usize = 64;
/// Attempts of an access with wrong read-backs.
const ATTEMPTS_MAX: usize = 3;

/// Bytes that one access at `address` can move when `left` remain.
fn size(address: u16, left: usize) -> usize {
    match (address % 4, left) {
        (0, 4..) => 4,
        (0 | 2, 2..) => 2,
        _ => 1,
    }
}

pub(super) fn command(address: u16, size: usize, direction: u32) -> u32 {
    BUSY | direction | (size as u32) << 16 | u32::from(address)
}

impl<SPI: SpiDevice> Lan9252<SPI> {
    /// Reads ESC registers, access by access.
    pub(super) async fn read_registers(
        &mut self,
        mut address: u16,
        mut into: &mut [u8],
    ) -> Result<(), EscError> {
        while let Some((part, rest)) = into.split_at_mut_checked(size(address, into.len())) {
            let value = self.read_register(address, part.len()).await?.to_le_bytes();
            part.iter_mut().zip(value).for_each(|(byte, value)| *byte = value);
            address = address.wrapping_add(part.len() as u16);
            into = rest;
        }
        Ok(())
    }

    /// Writes ESC registers, access by access.
    pub(super) async fn write_registers(
        &mut self,
        mut address: u16,
        mut bytes: &[u8],
    ) -> Result<(), EscError> {
        while let Some((part, rest)) = bytes.split_at_checked(size(address, bytes.len())) {
            let mut value = [0; 4];
            value.iter_mut().zip(part).for_each(|(value, byte)| *value = *byte);
            self.write_register(address, part.len(), u32::from_le_bytes(value)).await?;
            address = address.wrapping_add(part.len() as u16);
            bytes = rest;
        }
        Ok(())
    }

    /// Reads one register. Valid if the command reads back correctly, and two reads of the value agree.
    pub(super) async fn read_register(&mut self, address: u16, size: usize) -> Result<u32, EscError> {
        let command = command(address, size, READ);
        for _ in 0..ATTEMPTS_MAX {
            self.settle_registers(address).await?;
            self.register_open = true;
            self.bus.write(COMMAND, command).await?;
            let (echo, value) = self.register_done(address).await?;
            if echo == command & !BUSY && self.bus.read(DATA).await? == value {
                return Ok(value);
            }
            self.incidents.repeated += 1;
        }
        Err(EscError::Garbled(address))
    }

    /// Writes one register. Repeating the write is harmless.
    async fn write_register(&mut self, address: u16, size: usize, value: u32) -> Result<(), EscError> {
        let command = command(address, size, 0);
        for _ in 0..ATTEMPTS_MAX {
            self.settle_registers(address).await?;
            self.register_open = true;
            self.bus.write_up(DATA, value, command).await?;
            if self.register_done(address).await? == (command & !BUSY, value) {
                return Ok(());
            }
            self.incidents.repeated += 1;
        }
        Err(EscError::Garbled(address))
    }

    /// Waits for the end of an unfinished access, as the engine takes no command before.
    async fn settle_registers(&mut self, address: u16) -> Result<(), EscError> {
        if self.register_open {
            self.register_done(address).await?;
        }
        Ok(())
    }

    /// Waits until the engine is idle; returns its command and data.
    async fn register_done(&mut self, address: u16) -> Result<(u32, u32), EscError> {
        for _ in 0..POLLS_MAX {
            let (command, data) = self.bus.read_down(COMMAND).await?;
            if command & BUSY == 0 {
                self.register_open = false;
                return Ok((command, data));
            }
        }
        Err(EscError::Stuck(address))
    }
}
