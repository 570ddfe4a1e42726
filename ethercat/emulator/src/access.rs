//! The processor's accesses (I, PDI), and each side's current write permissions.

use crate::Nanos;
use crate::chip::Chip;
use crate::dc::latch;
use crate::fmmu;
use crate::registers::*;
use crate::sync_manager::{self, Side};

impl Chip {
    /// Whether `side` may write a register now.
    pub(crate) fn may_write(&self, side: Side, address: u16) -> bool {
        let sync_owner = if self.memory.byte(SYNC_UNIT) & 1 == 0 { Side::Ecat } else { Side::Pdi };
        let fmmus = FMMU..FMMU + fmmu::BYTES * u16::from(self.kind.fmmus);
        let managers = SYNC_MANAGER..SYNC_MANAGER + sync_manager::BYTES * u16::from(self.kind.sync_managers);
        match address {
            0x0120..=0x0121 => side == Side::Ecat && !self.events.al_control,
            EEPROM_PDI => side == Side::Pdi && self.eeprom.may_be_taken(&self.memory),
            0x0502..=0x050F => self.eeprom.accepts(&self.memory, side),
            _ if fmmus.contains(&address) => side == Side::Ecat && address % fmmu::BYTES < 13,
            _ if managers.contains(&address) => self.may_write_manager(side, address),
            _ if sync_writes(address) => side == sync_owner,
            0x09A8..=0x09A9 => side == latch::owner(&self.memory, usize::from(address - LATCH_CONTROL)),
            _ if side == Side::Ecat => ecat_writes(address),
            _ => pdi_writes(address),
        }
    }

    /// The buffer's location may be changed only while the SyncManager is off.
    fn may_write_manager(&self, side: Side, address: u16) -> bool {
        let offset = address % sync_manager::BYTES;
        let active = self.memory.byte(address - offset + sync_manager::ACTIVATE) & 1 != 0;
        match (side, offset) {
            (Side::Ecat, sync_manager::ACTIVATE) => true,
            (Side::Ecat, ..=sync_manager::CONTROL) => !active,
            (Side::Pdi, sync_manager::PDI_CONTROL) => true,
            _ => false,
        }
    }

    /// A read by the processor. Protected bytes read as zeros and count as an error.
    pub fn read(&mut self, at: Nanos, address: u16, into: &mut [u8]) {
        self.advance(at);
        self.clock.show_processor(&mut self.memory, at);
        let mut rest = into;
        let mut address = address;
        while !rest.is_empty() {
            let (place, count) = match address {
                // Any register may have side effects.
                ..PROCESS_RAM => (Some(address), 1),
                _ => self.managers.steps(Side::Pdi, false, address, rest.len() as u16),
            };
            let (now, later) = rest.split_at_mut(count.into());
            let found = place.map_or(&[][..], |place| self.memory.span(place, count));
            now[..found.len()].copy_from_slice(found);
            now[found.len()..].fill(0);
            let missing = now.len() - found.len();
            if address < PROCESS_RAM {
                self.after_read(address);
            }
            (0..missing).for_each(|_| self.count_pdi_error());
            (rest, address) = (later, address.wrapping_add(count));
        }
        self.accessed(at);
    }

    /// A write by the processor.
    pub fn write(&mut self, at: Nanos, address: u16, bytes: &[u8]) {
        self.advance(at);
        let mut registers = Vec::new();
        let mut rest = bytes;
        let mut address = address;
        while !rest.is_empty() {
            let (place, count) = match address {
                ..PROCESS_RAM => (self.may_write(Side::Pdi, address).then_some(address), 1),
                _ => self.managers.steps(Side::Pdi, true, address, rest.len() as u16),
            };
            let (now, later) = rest.split_at(count.into());
            let room = place.map_or(0, |place| self.memory.span(place, count).len());
            if let Some(place) = place.filter(|_| room > 0) {
                self.memory.put(place, &now[..room]);
            }
            (room..now.len()).for_each(|_| self.count_pdi_error());
            registers.extend(place.filter(|place| *place < PROCESS_RAM));
            (rest, address) = (later, address.wrapping_add(count));
        }
        for address in registers {
            self.after_write(Side::Pdi, address, at);
        }
        self.managers.take_watchdog_trigger();
        self.accessed(at);
    }

    /// Whether the interrupt is asserted.
    pub fn interrupt(&mut self, at: Nanos) -> bool {
        self.advance(at);
        self.memory.double_word(AL_EVENT) & self.memory.double_word(AL_EVENT_MASK) != 0
    }

    fn accessed(&mut self, at: Nanos) {
        self.pdi_watchdog.trigger(&self.memory, at);
        self.refresh(at);
        self.wake();
    }

    fn count_pdi_error(&mut self) {
        let counter = PROCESSING_ERRORS + 1;
        self.memory.set_byte(counter, self.memory.byte(counter).saturating_add(1));
    }
}
