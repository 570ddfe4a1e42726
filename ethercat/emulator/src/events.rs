//! Event requests to the MainDevice and to the processor (I, Interrupts; II, 0200h to 0223h).

use crate::sync_manager::{Side, SyncManagers};

const LATCHED_FOR_MAIN_DEVICE: u16 = 1 << 0;
const DL_STATUS: u16 = 1 << 2;
const AL_STATUS: u16 = 1 << 3;

const AL_CONTROL: u32 = 1 << 0;
const LATCHED: u32 = 1 << 1;
const SYNC: [u32; 2] = [1 << 2, 1 << 3];
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
    /// A latch has the time of an edge, for the MainDevice and for the processor.
    pub(crate) latched: [bool; 2],
    /// SYNC0 and SYNC1, where they are events.
    pub(crate) sync: [bool; 2],
}

impl Events {
    /// The ECAT event request.
    pub(crate) fn to_main_device(&self, managers: &SyncManagers) -> u16 {
        let bit = |set: bool, bit: u16| if set { bit } else { 0 };
        let first = bit(self.latched[0], LATCHED_FOR_MAIN_DEVICE)
            | bit(self.dl_status, DL_STATUS)
            | bit(self.al_status, AL_STATUS);
        managers.events(Side::Ecat).take_while(|nth| *nth < 8).fold(first, |bits, nth| bits | 1 << (4 + nth))
    }

    /// The AL event request.
    pub(crate) fn to_processor(&self, managers: &SyncManagers) -> u32 {
        let bit = |set: bool, bit: u32| if set { bit } else { 0 };
        let first = bit(self.al_control, AL_CONTROL)
            | bit(self.latched[1], LATCHED)
            | bit(self.sync[0], SYNC[0])
            | bit(self.sync[1], SYNC[1])
            | bit(self.activation != 0, SM_ACTIVATION)
            | bit(self.watchdog, WATCHDOG);
        managers.events(Side::Pdi).fold(first, |bits, nth| bits | 1 << (8 + nth))
    }
}
