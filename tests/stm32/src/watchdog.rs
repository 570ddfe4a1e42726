//! The independent watchdog, on an oscillator of 32 kHz (RM0090, 21; RM0410, 25; RM0433, 46).

use crate::time::{SECOND, Time};

const LSI_HZ: u64 = 32_000;

/// The watchdog, which never stops once it runs.
#[derive(Default)]
pub(crate) struct Watchdog {
    prescaler: u32,
    reload: u32,
    window: u32,
    unlocked: bool,
    running: bool,
    ends_at: Option<Time>,
}

impl Watchdog {
    pub(crate) fn new() -> Self {
        Self { reload: 0xfff, window: 0xfff, ..Self::default() }
    }

    pub(crate) fn read(&self, offset: u32) -> Option<u32> {
        match offset {
            0 | 0xc => Some(0),
            4 => Some(self.prescaler),
            8 => Some(self.reload),
            0x10 => Some(self.window),
            _ => None,
        }
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32, now: Time) -> Option<()> {
        match (offset, value) {
            (0, 0x5555) => self.unlocked = true,
            (0, key) => {
                self.unlocked = false;
                self.running |= key == 0xcccc;
                if self.running && matches!(key, 0xaaaa | 0xcccc) {
                    let counts = u64::from(self.reload + 1) * (4 << self.prescaler.min(6));
                    self.ends_at = Some(now + counts * SECOND / LSI_HZ);
                }
            }
            (4 | 8 | 0x10, _) if !self.unlocked => {}
            (4, _) => self.prescaler = value & 7,
            (8, _) => self.reload = value & 0xfff,
            (0x10, _) => self.window = value & 0xfff,
            _ => return None,
        }
        Some(())
    }

    /// When it resets the chip.
    pub(crate) fn next_event(&self) -> Option<Time> {
        self.ends_at
    }
}
