//! Side effects of register accesses, and the computed registers.

use crate::Nanos;
use crate::chip::Chip;
use crate::dc::sync::{SyncLine, SyncUnit};
use crate::registers::*;
use crate::sync_manager::{self, Side};

/// Device emulation in register 0141h: AL status follows AL control.
const DEVICE_EMULATION: u8 = 1;
const EEPROM_FORCE: u8 = 1 << 1;
const EEPROM_TAKEN: u8 = 1;

impl Chip {
    /// Side effects of a register write.
    pub(crate) fn after_write(&mut self, side: Side, address: u16, at: Nanos) {
        match address {
            ECAT_RESET if self.ecat_reset.step(self.memory.byte(address)) => self.reset(),
            PDI_RESET if self.pdi_reset.step(self.memory.byte(address)) => self.reset(),
            AL_CONTROL => self.al_control_written(),
            0x0130 if side == Side::Pdi => self.events.al_status = true,
            0x0300..=0x030B => self.memory.clear(ERROR_COUNTERS..=0x030B),
            0x030C | 0x030D => self.memory.clear(address..=address),
            0x0310..=0x0313 => self.memory.clear(LOST_LINK..=0x0313),
            0x0442..=0x0443 => self.memory.clear(WATCHDOG_COUNTERS..=0x0443),
            EEPROM_CONFIG if self.memory.byte(address) & EEPROM_FORCE != 0 => {
                let taken = self.memory.byte(EEPROM_PDI) & !EEPROM_TAKEN;
                self.memory.set_byte(EEPROM_PDI, taken);
            }
            0x0503 => {
                self.eeprom.command(&self.memory, at);
                self.advance(at);
            }
            0x0800..=0x08FF => self.manager_written(side, address, at),
            0x0913 if side == Side::Ecat => {
                let reference = self.memory.double_word(SYSTEM_TIME);
                self.clock.compare(&mut self.memory, reference, at);
            }
            SYNC_ACTIVATION => self.activate_sync(at),
            // The last byte of the start time.
            0x0997 if SyncUnit::starts_by_time(&mut self.memory) => self.activate_sync(at),
            _ => {}
        }
    }

    pub(crate) fn activate_sync(&mut self, at: Nanos) {
        let time = self.clock.system(&self.memory, at);
        self.sync.activate(&self.memory, time);
    }

    /// In device emulation, AL status follows AL control without the processor.
    fn al_control_written(&mut self) {
        if self.memory.byte(PDI_CONTROL + 1) & DEVICE_EMULATION != 0 {
            let state = self.memory.byte(AL_CONTROL) & 0x0F;
            self.memory.set_byte(AL_STATUS, state);
        } else {
            self.events.al_control = true;
        }
    }

    /// The processor writes a SyncManager's PDI control: it is switched off at the end of the frame in progress (II, 0807h).
    pub(crate) fn pdi_control_written(&mut self, address: u16, at: Nanos) {
        self.switching_off.retain(|(pending, _)| *pending != address);
        let written = self.memory.byte(address);
        if written & sync_manager::OFF != 0 && !self.managers.is_held(address) && at < self.frame_end {
            self.switching_off.push((address, self.frame_end));
            self.memory.set_byte(address, written & !sync_manager::OFF);
        }
    }

    /// Switches off SyncManagers that are due.
    pub(crate) fn switch_off(&mut self, at: Nanos) {
        for (address, due) in std::mem::take(&mut self.switching_off) {
            if due > at {
                self.switching_off.push((address, due));
                continue;
            }
            self.memory.set_byte(address, self.memory.byte(address) | sync_manager::OFF);
            self.managers.refresh(&mut self.memory);
        }
    }

    /// A SyncManager that either side switches off is cleared at once, as the next datagram may switch it on again.
    fn manager_written(&mut self, side: Side, address: u16, at: Nanos) {
        if side == Side::Ecat && address % sync_manager::BYTES == sync_manager::ACTIVATE {
            self.events.activation |= 1 << ((address - SYNC_MANAGER) / sync_manager::BYTES);
        }
        if side == Side::Pdi && address % sync_manager::BYTES == sync_manager::PDI_CONTROL {
            self.pdi_control_written(address, at);
        }
        self.managers.refresh(&mut self.memory);
    }

    /// Side effects of a register read by the processor.
    pub(crate) fn after_read(&mut self, address: u16) {
        match address {
            0x0120..=0x0121 => self.events.al_control = false,
            WATCHDOG_STATUS => self.events.watchdog = false,
            0x0800..=0x08FF if address % sync_manager::BYTES == sync_manager::ACTIVATE => {
                self.events.activation &= !(1 << ((address - SYNC_MANAGER) / sync_manager::BYTES));
            }
            SYNC0_STATUS => self.sync.acknowledge(SyncLine::Sync0),
            SYNC1_STATUS => self.sync.acknowledge(SyncLine::Sync1),
            0x09B0..=0x09CF => self.latches.read(&self.memory, Side::Pdi, address),
            _ => {}
        }
    }

    /// Updates the computed registers.
    pub(crate) fn refresh(&mut self, at: Nanos) {
        let memory = &mut self.memory;
        let link = |open: bool, port: u32| {
            if open { 1 << (4 + port) | 2 << (8 + 2 * port) } else { 1 << (8 + 2 * port) }
        };
        let ports = (0..).zip(self.ports).fold(0, |bits, (port, open)| bits | link(open, port));
        let flags = u16::from(self.eeprom.is_loaded()) | u16::from(self.pdi_watchdog.is_fine()) << 1;
        memory.put(DL_STATUS, &(flags | ports).to_le_bytes());
        memory.set_byte(WATCHDOG_STATUS, u8::from(self.process_watchdog.is_fine()));
        memory.put(EEPROM_CONTROL, &self.eeprom.status().to_le_bytes());
        self.managers.refresh(memory);
        self.clock.show(memory, at);
        self.sync.show(memory);
        self.latches.show(memory);
        self.events.latched = [Side::Ecat, Side::Pdi].map(|side| self.latches.is_event(memory, side));
        self.events.sync = SyncLine::ALL.map(|line| self.sync.is_event(memory, line));
        let ecat = self.events.to_main_device(&self.managers);
        memory.put(ECAT_EVENT, &ecat.to_le_bytes());
        let al = self.events.to_processor(&self.managers);
        memory.put(AL_EVENT, &al.to_le_bytes());
    }
}
