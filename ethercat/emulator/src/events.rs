//! Event requests to the MainDevice and to the processor (I, Interrupts; II, 0200h to 0223h).

use crate::dc;
use crate::sync_manager::{Side, SyncManagers};

const DL_STATUS: u16 = 1 << 2;
const AL_STATUS: u16 = 1 << 3;

const AL_CONTROL: u32 = 1 << 0;
const SYNC0: u32 = 1 << 2;
const SM_ACTIVATION: u32 = 1 << 4;
const WATCHDOG: u32 = 1 << 6;

/// Latched events, cleared by access to their cause.
#[derive(Debug, Clone, Default)]
pub(crate) struct Events {
    /// AL control was written and not yet read by the processor.
    pub(crate) al_control: bool,
    /// SyncManagers whose activation was written, one bit each.
    pub(crate) activation: u32,
    /// The process data watchdog expired.
    pub(crate) watchdog: bool,
    /// AL status was written and not yet read by the MainDevice.
    pub(crate) al_status: bool,
    /// DL status changed.
    pub(crate) dl_status: bool,
}

impl Events {
    /// The ECAT event request.
    pub(crate) fn to_main_device(&self, managers: &SyncManagers) -> u16 {
        let first = if self.dl_status { DL_STATUS } else { 0 } | if self.al_status { AL_STATUS } else { 0 };
        managers.events(Side::Ecat).take_while(|nth| *nth < 8).fold(first, |bits, nth| bits | 1 << (4 + nth))
    }

    /// The AL event request.
    pub(crate) fn to_processor(&self, managers: &SyncManagers, clock: &dc::Clock) -> u32 {
        let bit = |set: bool, bit: u32| if set { bit } else { 0 };
        let first = bit(self.al_control, AL_CONTROL)
            | bit(clock.sync0_event(), SYNC0)
            | bit(self.activation != 0, SM_ACTIVATION)
            | bit(self.watchdog, WATCHDOG);
        managers.events(Side::Pdi).fold(first, |bits, nth| bits | 1 << (8 + nth))
    }
}
