//! The values behind the gateway's objects.

use core::fmt::Write;

use embassy_time::Instant;
use heapless::String;

use super::configuration::{ConfigError, Configuration};
use super::layout::DeviceLayout;
use super::objects::{MODBUS_DEVICES_MAX, REASON_BYTES};
use super::place::EthercatPlace;
use crate::ethercat::application::{Address, Application};
use crate::ethercat::coe::abort::Abort;
use crate::ethercat::dictionary::number;
use crate::scanner::DeviceStatus;

/// Reads and writes of configuration, layout and buffers.
pub struct GatewayObjects<'p> {
    place: &'p EthercatPlace,
    configuration: Configuration,
    layouts: [DeviceLayout; MODBUS_DEVICES_MAX],
    /// Why the configuration was refused that was to be used last.
    refused: Option<ConfigError>,
    /// Whether the outputs come from a MainDevice that is in Op now.
    outputs_valid: bool,
    /// Advances when inputs are renewed, so that a MainDevice can tell stale ones.
    input_counter: u8,
}

impl<'p> GatewayObjects<'p> {
    /// The objects after power-on.
    pub fn new(place: &'p EthercatPlace) -> Self {
        Self {
            place,
            configuration: Configuration::default(),
            layouts: [DeviceLayout::default(); MODBUS_DEVICES_MAX],
            refused: None,
            outputs_valid: false,
            input_counter: 0,
        }
    }

    /// The configuration as it was written last.
    pub fn configuration(&self) -> &Configuration {
        &self.configuration
    }

    /// Whether the outputs come from a MainDevice that is in Op now.
    pub fn outputs_valid(&self) -> bool {
        self.outputs_valid
    }

    /// The number at `at`, of all but buffers and texts.
    fn number(&self, at: Address) -> Option<u32> {
        let sub = usize::from(at.sub.checked_sub(1)?);
        Some(match at.index {
            // The request to take the configuration over is served at once, so it never reads as set.
            0x2005 => u32::from(sub == 1 && self.place.is_running()),
            0x2011..=0x2014 => (*self.layouts.get(usize::from(at.index - 0x2011))?.0.get(sub)?).into(),
            0x2030 => self.input_counter.into(),
            0x2031 => health(self.place.device_status(sub as u8).as_ref()).into(),
            0x2180..=0x2183 => {
                let status = self.place.device_status((at.index - 0x2180) as u8);
                status_number(status.as_ref(), sub)?
            }
            _ => return self.configuration.number(at),
        })
    }

    fn set(&mut self, at: Address, value: u32) -> Option<()> {
        match (at.index, at.sub) {
            (0x2005, 1) if value == 1 => self.take_over(),
            (0x2005, 2) => self.place.stop(),
            (0x2005, _) => {}
            _ => return self.configuration.set(at, value),
        }
        Some(())
    }

    /// Uses the configuration as a whole; one that cannot be used leaves everything as it is.
    fn take_over(&mut self) {
        match self.place.start(&self.configuration) {
            Ok(layouts) => self.layouts = layouts,
            Err(error) => self.refused = Some(error),
        }
    }

    /// Whether the configuration can be used; notes why not.
    fn check_configuration(&mut self) -> Result<(), Abort> {
        self.refused = self.place.check(&self.configuration).err();
        match self.refused {
            None => Ok(()),
            Some(ConfigError::NoPort) => Err(Abort::LocalControl),
            Some(_) => Err(Abort::Incompatible),
        }
    }

    /// Why a configuration was refused, in words (2006h).
    fn reason(&self) -> String<{ REASON_BYTES as usize }> {
        let mut text = String::new();
        if let Some(error) = self.refused {
            // Every reason fits; see the test.
            let _ = write!(text, "{error}");
        }
        text
    }
}

/// 0: not asked yet; 1: well; 2: not normal.
fn health(status: Option<&DeviceStatus>) -> u8 {
    match status.and_then(|status| status.alive) {
        None => 0,
        Some(true) => 1,
        Some(false) => 2,
    }
}

/// The entries of 2180h and following.
fn status_number(status: Option<&DeviceStatus>, sub: usize) -> Option<u32> {
    if sub > 7 {
        return None;
    }
    // A device that there is not has never been heard of.
    let never = if sub == 1 { u32::MAX } else { 0 };
    let Some(status) = status else { return Some(never) };
    Some(match sub {
        0 => health(Some(status)).into(),
        1 if status.heard == Instant::MIN => never,
        1 => u32::try_from(status.heard.elapsed().as_millis()).unwrap_or(u32::MAX),
        2 => status.exception.into(),
        3 => status.error.map_or(0, |error| error as u32),
        4 => status.requests,
        5 => status.answers,
        6 => status.exceptions,
        _ => status.failures,
    })
}

/// Copies the entry `sub` of `buffer` into `into`.
fn copy_entry(buffer: &[u8], sub: u8, into: &mut [u8]) -> Result<(), Abort> {
    let start = usize::from(sub).saturating_sub(1) * into.len();
    into.copy_from_slice(buffer.get(start..start + into.len()).ok_or(Abort::General)?);
    Ok(())
}

impl Application for GatewayObjects<'_> {
    fn read(&mut self, at: Address, into: &mut [u8]) -> Result<usize, Abort> {
        match at.index {
            0x2021 | 0x2023 => self.place.inputs(|buffer| copy_entry(buffer, at.sub, into))?,
            0x2022 | 0x2024 => self.place.outputs(|buffer| copy_entry(buffer, at.sub, into))?,
            0x2006 => {
                let reason = self.reason();
                into.fill(0);
                into.iter_mut().zip(reason.bytes()).for_each(|(place, byte)| *place = byte);
            }
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
            0x2000..=0x2004 | 0x2007 | 0x2020 if self.place.is_running() => Err(Abort::State),
            0x2005 if at.sub == 1 && number == 1 => self.check_configuration(),
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
        if let 0x1600 | 0x1601 = pdo {
            self.place.put_outputs(bytes);
            self.outputs_valid = true;
        }
    }

    fn inputs(&mut self, pdo: u16, into: &mut [u8]) {
        match pdo {
            0x1a00 | 0x1a01 => self.place.inputs(|buffer| {
                into.iter_mut().zip(buffer).for_each(|(place, byte)| *place = *byte);
            }),
            0x1a03 => {
                let devices = into.iter_mut().zip(0..);
                devices.for_each(|(byte, nth)| *byte = health(self.place.device_status(nth).as_ref()));
            }
            _ => {
                self.input_counter = self.input_counter.wrapping_add(1);
                into.fill(self.input_counter);
            }
        }
    }

    fn outputs_stopped(&mut self) {
        self.outputs_valid = false;
        self.place.outputs_stopped();
    }
}
