//! Power-on and reset: initial register values (II), and the configuration from the EEPROM (I, SII EEPROM, "ESC configuration
//! area").

use crate::chip::Chip;
use crate::dc::latch::Latches;
use crate::events::Events;
use crate::registers::*;
use crate::sync_manager::SyncManagers;
use crate::watchdog::Watchdog;

/// Process data memory after power-on: undefined, so not zeros.
const UNDEFINED: u8 = 0xA5;
/// Ports: two with MII, two absent.
const PORTS: u8 = 0x0F;

impl Chip {
    /// Resets the chip, as at power-on. The EEPROM keeps its content, the clock runs on.
    pub fn reset(&mut self) {
        let end = (self.memory.len() - 1) as u16;
        self.memory.clear(0..=PROCESS_RAM - 1);
        for address in PROCESS_RAM..=end {
            self.memory.set_byte(address, UNDEFINED);
        }
        self.managers = SyncManagers::new(&self.memory, self.kind.sync_managers);
        self.events = Events::default();
        self.switching_off.clear();
        self.process_watchdog = Watchdog::of_process_data();
        self.pdi_watchdog = Watchdog::of_pdi();
        (self.ecat_reset, self.pdi_reset) = Default::default();
        self.first_values();
        if let Some(config) = self.eeprom.load() {
            self.configure(&config);
            // Only at reset: a reload does not update the alias.
            self.memory.put(ALIAS, &config[8..10]);
        }
        self.activate_sync(0);
        self.latches = Latches::default();
    }

    fn first_values(&mut self) {
        let kind = self.kind;
        self.memory.put(TYPE, &kind.identity);
        self.memory.put(TYPE + 4, &[kind.fmmus, kind.sync_managers, kind.ram_kib, PORTS]);
        self.memory.put(TYPE + 8, &kind.features.to_le_bytes());
        self.memory.put(DL_CONTROL, &[0x01, 0, 0x07, 0]);
        self.memory.put(AL_CONTROL, &[1]);
        self.memory.put(AL_STATUS, &[1]);
        self.memory.put(WATCHDOG_DIVIDER, &2498u16.to_le_bytes());
        self.memory.put(WATCHDOG_PDI, &1000u16.to_le_bytes());
        self.memory.put(WATCHDOG_DATA, &1000u16.to_le_bytes());
        self.memory.put(SPEED_START, &0x1000u16.to_le_bytes());
        self.memory.put(FILTERS, &[4, 12]);
    }

    /// Applies the configuration area: PDI, SYNC pulse.
    pub(crate) fn configure(&mut self, config: &[u8; 16]) {
        self.memory.put(PDI_CONTROL, &config[0..2]);
        self.memory.put(PDI_CONFIG, &config[2..4]);
        self.memory.put(PULSE_LENGTH, &config[4..6]);
        self.memory.put(PDI_CONFIG + 2, &config[6..8]);
    }
}
