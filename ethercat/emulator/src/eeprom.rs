//! The chip's EEPROM: the SubDevice information (SII), accessed word by word from either side (I, SII EEPROM; II, 0500h to 050Fh).

use crate::Nanos;
use crate::memory::Memory;
use crate::registers::{EEPROM_ADDRESS, EEPROM_CONFIG, EEPROM_CONTROL, EEPROM_DATA, EEPROM_PDI};
use crate::sync_manager::Side;

/// Bytes of the configuration area, with its checksum.
const CONFIG_BYTES: usize = 16;
/// A checksum word that disables the check.
const UNCHECKED: [u8; 2] = [0xA4, 0x88];

const WRITE_ENABLE: u16 = 1 << 0;
const READS_EIGHT: u16 = 1 << 6;
const TWO_ADDRESS_BYTES: u16 = 1 << 7;
const CHECKSUM_ERROR: u16 = 1 << 11;
const NOT_LOADED: u16 = 1 << 12;
const COMMAND_ERROR: u16 = 1 << 13;
const ENABLE_ERROR: u16 = 1 << 14;
const BUSY: u16 = 1 << 15;

/// The EEPROM and the chip's interface to it.
#[derive(Debug, Clone)]
pub struct Eeprom {
    content: Vec<u8>,
    /// How long a command takes.
    pub busy_nanos: Nanos,
    done: Option<(Nanos, Job)>,
    errors: u16,
    reads_eight: bool,
}

#[derive(Debug, Clone, Copy)]
enum Job {
    Read,
    Write,
    Reload,
}

impl Eeprom {
    /// An EEPROM with this content; bytes beyond it read FFh. A read returns eight bytes, or four.
    pub(crate) fn new(content: Vec<u8>, reads_eight: bool) -> Self {
        Self { content, busy_nanos: 0, done: None, errors: 0, reads_eight }
    }

    /// The content.
    pub fn content(&self) -> &[u8] {
        &self.content
    }

    /// The checksum of the first fourteen bytes: polynomial x^8 + x^2 + x + 1, initial value FFh.
    pub fn check(config: &[u8]) -> u8 {
        let shift = |crc: u8| if crc & 0x80 != 0 { crc << 1 ^ 0x07 } else { crc << 1 };
        config.iter().take(14).fold(0xFF, |crc, byte| (0..8).fold(crc ^ byte, |crc, _| shift(crc)))
    }

    /// The configuration area if its checksum is valid; otherwise the chip stays unconfigured.
    pub(crate) fn load(&mut self) -> Option<[u8; CONFIG_BYTES]> {
        self.done = None;
        let config: [u8; CONFIG_BYTES] = std::array::from_fn(|nth| self.byte(nth));
        let good = config[14..] == [Self::check(&config), 0] || config[14..] == UNCHECKED;
        self.errors = if good { 0 } else { CHECKSUM_ERROR | NOT_LOADED };
        good.then_some(config)
    }

    pub(crate) fn is_loaded(&self) -> bool {
        self.errors & NOT_LOADED == 0
    }

    /// Whether `side` may use the interface now.
    pub(crate) fn accepts(&self, memory: &Memory, side: Side) -> bool {
        let taken = memory.byte(EEPROM_PDI) & 1 != 0;
        let free = memory.byte(EEPROM_CONFIG) & 1 == 0 && !taken;
        let owns = if side == Side::Pdi { taken } else { free };
        owns && self.done.is_none()
    }

    /// Whether the processor may claim the interface: it was handed over, or has not been returned yet.
    pub(crate) fn may_be_taken(&self, memory: &Memory) -> bool {
        (memory.byte(EEPROM_CONFIG) | memory.byte(EEPROM_PDI)) & 1 != 0
    }

    /// Starts the command in the control register.
    pub(crate) fn command(&mut self, memory: &Memory, at: Nanos) {
        let control = memory.word(EEPROM_CONTROL);
        self.errors &= CHECKSUM_ERROR | NOT_LOADED;
        let job = match control >> 8 & 7 {
            0 => return,
            1 => Job::Read,
            2 if control & WRITE_ENABLE == 0 => {
                self.errors |= ENABLE_ERROR;
                return;
            }
            2 => Job::Write,
            // SOEM uses 3 for reload.
            3 | 4 => Job::Reload,
            _ => {
                self.errors |= COMMAND_ERROR;
                return;
            }
        };
        self.done = Some((at + self.busy_nanos, job));
    }

    /// Completes a command that is due; returns the configuration after a valid reload.
    pub(crate) fn advance(&mut self, memory: &mut Memory, at: Nanos) -> Option<[u8; CONFIG_BYTES]> {
        let (_, job) = self.done.take_if(|(done, _)| *done <= at)?;
        let address = memory.double_word(EEPROM_ADDRESS) as usize * 2;
        match job {
            Job::Read => {
                let data: [u8; 8] = std::array::from_fn(|nth| self.byte(address + nth));
                let bytes = if self.reads_eight { 8 } else { 4 };
                memory.put(EEPROM_DATA, &data[..bytes]);
            }
            Job::Write => {
                if let Some(place) = self.content.get_mut(address..address + 2) {
                    place.copy_from_slice(&memory.bytes::<2>(EEPROM_DATA));
                } else {
                    self.errors |= COMMAND_ERROR;
                }
            }
            Job::Reload => return self.load(),
        }
        None
    }

    /// The current control and status register.
    pub(crate) fn status(&self) -> u16 {
        let fixed = TWO_ADDRESS_BYTES | if self.reads_eight { READS_EIGHT } else { 0 };
        let command = |job| match job {
            Job::Read => 1 << 8,
            Job::Write => 2 << 8 | WRITE_ENABLE,
            Job::Reload => 4 << 8,
        };
        fixed | self.errors | self.done.map_or(0, |(_, job)| BUSY | command(job))
    }

    pub(crate) fn next(&self) -> Option<Nanos> {
        self.done.map(|(done, _)| done)
    }

    fn byte(&self, at: usize) -> u8 {
        self.content.get(at).copied().unwrap_or(0xFF)
    }
}
