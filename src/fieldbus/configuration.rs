//! The configuration written by a MainDevice (2000h to 2020h, 2100h and following), and its validation as a whole.

use ethercat_subdevice::application::Address;
use heapless::Vec;

use super::config_error::ConfigError;
use super::layout::layouts;
use super::line::Speed;
use super::room::Room;
use super::slaves::{ModbusSlave, SLAVES_FIRST, SLAVES_MAX, default_unit};
use crate::scanner::{ByteOrder, ValueType};
use crate::settings::{OnSilence, SlaveSettings};

/// Register types, by number (8nn0h:0E and 0F).
pub(super) const TYPES: &[ValueType] = ValueType::NUMBERS;
/// Byte orders, by number (8nn0h:10).
pub(super) const ORDERS: [ByteOrder; 4] =
    [ByteOrder::Order0123, ByteOrder::Order2301, ByteOrder::Order1032, ByteOrder::Order3210];

const fn on_silence(number: u32) -> OnSilence {
    match number {
        1 => OnSilence::Clear,
        2 => OnSilence::Substitute,
        _ => OnSilence::Hold,
    }
}

/// Entry number `place`, from 0, of a slave's configuration.
pub(super) fn setting(slave: &SlaveSettings, place: usize) -> Option<u32> {
    Some(match place {
        0 => slave.unit.into(),
        9 => slave.polling_ms,
        10 => slave.on_silence as u32,
        11 => slave.substitute.into(),
        12 => slave.check.into(),
        13 | 14 => TYPES.iter().position(|one| slave.types.get(place - 13) == Some(one))? as u32,
        15 => ORDERS.iter().position(|one| *one == slave.order)? as u32,
        _ => {
            let cells = slave.cells.get((place - 1) / 2)?;
            u32::from(if place % 2 == 1 { cells.count } else { cells.address })
        }
    })
}

/// The configuration as last written, whether usable or not.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Configuration {
    /// Number of `slaves` in use (2000h).
    count: u8,
    /// All slaves, or empty until first accessed, so that the initial value is all zeros.
    slaves: Vec<SlaveSettings, SLAVES_MAX, u8>,
    uart: [u32; 4],
}

impl Configuration {
    /// Before the first access.
    pub(super) const EMPTY: Self = Self { count: 0, slaves: Vec::new(), uart: [0; 4] };
    /// 2020h after power-on.
    const UART: [u32; 4] = [115_200, 0, 0, 0];

    /// The configuration, filled with defaults at the first access.
    pub(super) fn filled(&mut self) -> &mut Self {
        if self.slaves.is_empty() {
            *self = Self { count: SLAVES_FIRST, slaves: Vec::new(), uart: Self::UART };
            self.fill_up();
        }
        self
    }

    /// Fills all missing slaves with defaults.
    fn fill_up(&mut self) {
        for nth in self.slaves.len()..SLAVES_MAX {
            // Within the capacity.
            let _ = self.slaves.push(SlaveSettings::new(default_unit(nth as u16)));
        }
    }

    /// Takes `slaves` from the settings, or the defaults if there are none.
    pub(super) fn replace(&mut self, slaves: &[SlaveSettings]) {
        self.filled();
        self.slaves.clear();
        // Within the capacity.
        let _ = self.slaves.extend_from_slice(slaves);
        self.fill_up();
        self.count = if slaves.is_empty() { SLAVES_FIRST } else { slaves.len() as u8 };
    }

    /// Takes over the line's settings.
    pub(super) fn set_speed(&mut self, speed: Speed) {
        self.filled().uart = speed.entries();
    }

    /// The slaves in use.
    pub fn slaves(&self) -> &[SlaveSettings] {
        self.slaves.get(..self.count.into()).unwrap_or_default()
    }

    /// Checks whether it fits the `room` for images; returns the required line settings.
    pub fn plan(&self, room: Room) -> Result<Speed, ConfigError> {
        layouts(self.slaves(), room).try_for_each(|layout| layout.map(|_| ()))?;
        Speed::from_entries(self.uart)
    }

    /// The number at `at`, if part of the configuration.
    pub(super) fn number(&self, at: Address) -> Option<u32> {
        let sub = usize::from(at.sub.checked_sub(1)?);
        Some(match at.index {
            0x2000 => self.count.into(),
            0x2007 => self.slaves.get(sub)?.check.into(),
            0x2008 => self.slaves.get(sub)?.on_silence as u32,
            0x2009 => self.slaves.get(sub)?.substitute.into(),
            0x2020 => *self.uart.get(sub)?,
            index => {
                let ModbusSlave::Configuration(nth) = ModbusSlave::of(index)? else { return None };
                let slave = self.slaves.get(nth)?;
                setting(slave, sub)?
            }
        })
    }

    /// Writes the number at `at`, if part of the configuration; the table has checked its range.
    pub(super) fn set(&mut self, at: Address, value: u32) -> Option<()> {
        let sub = usize::from(at.sub.checked_sub(1)?);
        match at.index {
            0x2000 => self.count = value as u8,
            0x2007 => self.slaves.get_mut(sub)?.check = value == 1,
            0x2008 => {
                self.slaves.get_mut(sub)?.on_silence = on_silence(value);
            }
            0x2009 => self.slaves.get_mut(sub)?.substitute = value as u16,
            0x2020 => *self.uart.get_mut(sub)? = value,
            index => {
                let ModbusSlave::Configuration(nth) = ModbusSlave::of(index)? else { return None };
                let slave = self.slaves.get_mut(nth)?;
                match sub {
                    0 => slave.unit = value as u8,
                    9 => slave.polling_ms = value,
                    10 => slave.on_silence = on_silence(value),
                    11 => slave.substitute = value as u16,
                    12 => slave.check = value == 1,
                    13 | 14 => *slave.types.get_mut(sub - 13)? = *TYPES.get(value as usize)?,
                    15 => slave.order = *ORDERS.get(value as usize)?,
                    _ => {
                        let cells = slave.cells.get_mut((sub - 1) / 2)?;
                        *(if sub % 2 == 1 { &mut cells.count } else { &mut cells.address }) = value as u16;
                    }
                }
            }
        }
        Some(())
    }
}

impl Default for Configuration {
    fn default() -> Self {
        let mut configuration = Self::EMPTY;
        configuration.filled();
        configuration
    }
}
