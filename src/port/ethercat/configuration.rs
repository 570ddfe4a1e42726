//! What a MainDevice has configured (2000h to 2004h, 2007h, 2020h), and whether it can be used, as a whole.

use super::layout::{DeviceLayout, DeviceSettings, KindSettings, layout};
use super::objects::MODBUS_DEVICES_MAX;
use crate::config::Parity;
use crate::ethercat::application::Address;
use crate::scanner::Kind;

/// Why a configuration cannot be used. Devices count from 0, as in the names of 2001h to 2004h.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ConfigError {
    /// The values that are read are longer than the buffer.
    #[error("slave {device} ends past input byte 119")]
    InputsFull {
        /// The first device for which there is no room.
        device: u8,
    },
    /// The values that are written are longer than the buffer.
    #[error("slave {device} ends past output byte 119")]
    OutputsFull {
        /// The first device for which there is no room.
        device: u8,
    },
    /// A kind's addresses would go past 65535.
    #[error("slave {device}: {kind} addresses past 65535")]
    PastLastAddress {
        /// The device.
        device: u8,
        /// What it should have there.
        kind: Kind,
    },
    /// Bits per character and parity that are no character of Modbus RTU.
    #[error("2020h: {bits} bits with parity {parity} are not RTU")]
    Character {
        /// Bits of a character, the parity bit among them.
        bits: u8,
        /// The parity mode.
        parity: u8,
    },
    /// No port asks Modbus devices for the MainDevice.
    #[error("no ethercat port is set")]
    NoPort,
}

/// How the serial line is to be set (2020h).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Speed {
    /// Bits a second.
    pub baud: u32,
    /// Parity; there are always eight data bits, as RTU needs.
    pub parity: Parity,
    /// One or two.
    pub stop_bits: u8,
}

/// What follows from a configuration that can be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Plan {
    /// Where the devices' values lie.
    pub layouts: [DeviceLayout; MODBUS_DEVICES_MAX],
    /// How the serial line is to be set.
    pub speed: Speed,
}

/// The configuration as it was written last; whether it can be used is another question.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Configuration {
    /// How many of `devices` there are (2000h).
    count: u16,
    devices: [DeviceSettings; MODBUS_DEVICES_MAX],
    uart: [u32; 4],
}

impl Default for Configuration {
    fn default() -> Self {
        let kinds = [KindSettings::default(); 4];
        let device = |id| DeviceSettings { id, kinds, polling_ms: 1_000, check: false };
        Self { count: MODBUS_DEVICES_MAX as u16, devices: [1, 2, 3, 4].map(device), uart: [115_200, 0, 0, 0] }
    }
}

impl Configuration {
    /// The devices that there are.
    pub fn devices(&self) -> &[DeviceSettings] {
        self.devices.get(..self.count.into()).unwrap_or_default()
    }

    /// Whether it can be used, and what follows from it.
    pub fn plan(&self) -> Result<Plan, ConfigError> {
        Ok(Plan { layouts: layout(self.devices())?, speed: self.speed()? })
    }

    /// The parity bit counts among the bits of a character: 8E1 has nine.
    fn speed(&self) -> Result<Speed, ConfigError> {
        let [baud, nine, parity, two_stop_bits] = self.uart;
        let parity = match (nine, parity) {
            (0, 0) => Parity::None,
            (1, 2) => Parity::Even,
            (1, 3) => Parity::Odd,
            _ => return Err(ConfigError::Character { bits: 8 + nine as u8, parity: parity as u8 }),
        };
        Ok(Speed { baud, parity, stop_bits: 1 + two_stop_bits as u8 })
    }

    /// The number at `at`, if it is one of these.
    pub(super) fn number(&self, at: Address) -> Option<u32> {
        let sub = usize::from(at.sub.checked_sub(1)?);
        Some(match at.index {
            0x2000 => self.count.into(),
            0x2001..=0x2004 => {
                let device = self.devices.get(usize::from(at.index - 0x2001))?;
                match sub {
                    0 => device.id.into(),
                    9 => device.polling_ms,
                    _ => {
                        let kind = device.kinds.get((sub - 1) / 2)?;
                        u32::from(if sub % 2 == 1 { kind.count } else { kind.address })
                    }
                }
            }
            0x2007 => self.devices.get(sub)?.check.into(),
            0x2020 => *self.uart.get(sub)?,
            _ => return None,
        })
    }

    /// Writes the number at `at`, if it is one of these; the table has checked its range.
    pub(super) fn set(&mut self, at: Address, value: u32) -> Option<()> {
        let sub = usize::from(at.sub.checked_sub(1)?);
        match at.index {
            0x2000 => self.count = value as u16,
            0x2001..=0x2004 => {
                let device = self.devices.get_mut(usize::from(at.index - 0x2001))?;
                match sub {
                    0 => device.id = value as u16,
                    9 => device.polling_ms = value,
                    _ => {
                        let kind = device.kinds.get_mut((sub - 1) / 2)?;
                        *(if sub % 2 == 1 { &mut kind.count } else { &mut kind.address }) = value as u16;
                    }
                }
            }
            0x2007 => self.devices.get_mut(sub)?.check = value == 1,
            0x2020 => *self.uart.get_mut(sub)? = value,
            _ => return None,
        }
        Some(())
    }
}
