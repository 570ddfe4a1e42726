//! The values behind the gateway's objects.

use super::layout::{DeviceLayout, DeviceSettings, KindSettings, layout};
use super::objects::{IMAGE_BYTES, MODBUS_DEVICES_MAX};
use crate::ethercat::application::{Address, Application};
use crate::ethercat::coe::abort::Abort;
use crate::ethercat::dictionary::number;

/// Reads and writes of configuration, layout and buffers.
#[derive(Debug)]
pub struct GatewayObjects {
    /// How many of `devices` there are (2000h).
    device_count: u16,
    devices: [DeviceSettings; MODBUS_DEVICES_MAX],
    uart: [u32; 4],
    /// Whether the configuration is in use (2005h:02).
    running: bool,
    layouts: [DeviceLayout; MODBUS_DEVICES_MAX],
    /// From the Modbus devices to the MainDevice.
    pub inputs: [u8; IMAGE_BYTES],
    /// From the MainDevice to the Modbus devices.
    pub outputs: [u8; IMAGE_BYTES],
    /// Whether `outputs` come from a MainDevice that is in Op now.
    pub outputs_valid: bool,
    /// Advances when inputs are renewed, so that a MainDevice can tell stale ones.
    input_counter: u8,
}

impl Default for GatewayObjects {
    fn default() -> Self {
        let device = |id| DeviceSettings { id, kinds: [KindSettings::default(); 4], polling_ms: 1_000 };
        Self {
            device_count: MODBUS_DEVICES_MAX as u16,
            devices: [1, 2, 3, 4].map(device),
            uart: [115_200, 0, 0, 0],
            running: false,
            layouts: [DeviceLayout::default(); MODBUS_DEVICES_MAX],
            inputs: [0; IMAGE_BYTES],
            outputs: [0; IMAGE_BYTES],
            outputs_valid: false,
            input_counter: 0,
        }
    }
}

impl GatewayObjects {
    /// The devices in use; none while the configuration is being changed.
    pub fn devices(&self) -> &[DeviceSettings] {
        if self.running { self.configured() } else { &[] }
    }

    fn configured(&self) -> &[DeviceSettings] {
        self.devices.get(..self.device_count.into()).unwrap_or_default()
    }

    /// The number at `at`, of all but the buffers.
    fn number(&self, at: Address) -> Option<u32> {
        let sub = usize::from(at.sub.checked_sub(1)?);
        Some(match at.index {
            0x2000 => self.device_count.into(),
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
            // The request to take the configuration over is served at once, so it never reads as set.
            0x2005 => u32::from(sub == 1 && self.running),
            0x2011..=0x2014 => (*self.layouts.get(usize::from(at.index - 0x2011))?.0.get(sub)?).into(),
            0x2020 => *self.uart.get(sub)?,
            0x2030 => self.input_counter.into(),
            _ => return None,
        })
    }

    fn set(&mut self, at: Address, value: u32) -> Option<()> {
        let sub = usize::from(at.sub.checked_sub(1)?);
        match at.index {
            0x2000 => self.device_count = value as u16,
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
            0x2005 if sub == 0 && value == 1 => self.take_over(),
            0x2005 if sub == 1 => self.running = false,
            0x2020 => *self.uart.get_mut(sub)? = value,
            _ => {}
        }
        Some(())
    }

    /// Uses the configuration, which was checked, with empty buffers.
    fn take_over(&mut self) {
        let Ok(layouts) = layout(self.configured()) else { return };
        self.layouts = layouts;
        self.inputs.fill(0);
        self.outputs.fill(0);
        self.running = true;
    }
}

/// The bytes of an entry of a buffer.
fn part(sub: u8, bytes: usize) -> core::ops::Range<usize> {
    let start = usize::from(sub).saturating_sub(1) * bytes;
    start..start + bytes
}

impl Application for GatewayObjects {
    fn read(&mut self, at: Address, into: &mut [u8]) -> Result<usize, Abort> {
        let place = part(at.sub, into.len());
        match at.index {
            0x2021 | 0x2023 => into.copy_from_slice(self.inputs.get(place).ok_or(Abort::General)?),
            0x2022 | 0x2024 => into.copy_from_slice(self.outputs.get(place).ok_or(Abort::General)?),
            _ => {
                let number = self.number(at).ok_or(Abort::General)?;
                into.iter_mut().zip(number.to_le_bytes()).for_each(|(place, byte)| *place = byte);
            }
        }
        Ok(into.len())
    }

    fn check(&mut self, at: Address, value: &[u8]) -> Result<(), Abort> {
        let number = number(value);
        match at.index {
            // A configuration in use is not changed under its devices.
            0x2000..=0x2004 | 0x2020 if self.running => Err(Abort::State),
            0x2005 if at.sub == 1 && number == 1 => {
                layout(self.configured()).map(|_| ()).map_err(|_| Abort::Incompatible)
            }
            // 1 would be mark parity, which no line here can do.
            0x2020 if at.sub == 3 && number == 1 => Err(Abort::Range),
            _ => Ok(()),
        }
    }

    fn write(&mut self, at: Address, value: &[u8]) {
        // The table has no writable entry that is not known here.
        self.set(at, number(value) as u32).unwrap_or_default();
    }

    fn outputs(&mut self, pdo: u16, bytes: &[u8]) {
        if let (0x1600 | 0x1601, Some(place)) = (pdo, self.outputs.get_mut(..bytes.len())) {
            place.copy_from_slice(bytes);
            self.outputs_valid = true;
        }
    }

    fn inputs(&mut self, pdo: u16, into: &mut [u8]) {
        match (pdo, self.inputs.get(..into.len())) {
            (0x1a00 | 0x1a01, Some(inputs)) => into.copy_from_slice(inputs),
            _ => {
                self.input_counter = self.input_counter.wrapping_add(1);
                into.fill(self.input_counter);
            }
        }
    }

    fn outputs_stopped(&mut self) {
        self.outputs_valid = false;
    }
}
