//! The Cortex-M7's caches, as far as they can do harm: instructions that are not the flash's, and memory that DMA and the program see
//! differently (ARMv7-M architecture, B2.2 and B3.5; PM0253, 4.6 and 4.8). Nothing is cached here.

/// CCR.DC, CCR.IC.
const DATA: u32 = 1 << 16;
const INSTRUCTIONS: u32 = 1 << 17;
const REGIONS: usize = 16;
/// Memory that is next to the processor and never cached: DTCM.
const DTCM: std::ops::Range<u32> = 0x2000_0000..0x2002_0000;

/// A region of the MPU: its registers RBAR and RASR.
#[derive(Clone, Copy, Default)]
struct Region {
    base: u32,
    attributes: u32,
}

impl Region {
    fn contains(&self, address: u32) -> bool {
        if self.attributes & 1 == 0 {
            return false;
        }
        let size = 2_u64 << (self.attributes >> 1 & 0x1f);
        let within = u64::from(address.wrapping_sub(self.base & !0x1f));
        // Eighths of a region can be off.
        within < size && self.attributes >> (8 + 8 * within / size) & 1 == 0
    }

    /// Its memory is normal, cacheable and not shared, which the Cortex-M7 does not cache.
    fn is_cached(&self) -> bool {
        let (extension, cacheable, bufferable) =
            (self.attributes >> 19 & 7, self.attributes >> 17 & 1 != 0, self.attributes >> 16 & 1 != 0);
        let is_cacheable = match extension {
            0 => cacheable,
            1 => cacheable && bufferable,
            // The inner policy.
            4.. => cacheable || bufferable,
            _ => false,
        };
        is_cacheable && self.attributes >> 18 & 1 == 0
    }
}

/// Both caches, and the MPU.
#[derive(Clone, Default)]
pub(crate) struct Caches {
    pub(crate) instructions: bool,
    pub(crate) data: bool,
    /// The cache of instructions was emptied since the reset, and since the flash was changed.
    is_empty: bool,
    control: u32,
    number: usize,
    regions: [Region; REGIONS],
    pub(crate) broken_rule: Option<&'static str>,
}

impl Caches {
    /// CCR is written.
    pub(crate) fn control(&mut self, value: u32) {
        (self.instructions, self.data) = (value & INSTRUCTIONS != 0, value & DATA != 0);
        if self.instructions && !self.is_empty {
            self.broken_rule = Some("enables the instruction cache, which holds anything,");
        }
    }

    /// ICIALLU is written.
    pub(crate) fn empty(&mut self) {
        self.is_empty = true;
    }

    /// Instructions in the flash are others now.
    pub(crate) fn change_instructions(&mut self) {
        self.is_empty = false;
        if self.instructions {
            self.broken_rule = Some("changes instructions that the instruction cache may hold,");
        }
    }

    pub(crate) fn read_mpu(&self, offset: u32) -> Option<u32> {
        let region = self.regions.get(self.number)?;
        Some(match offset {
            0xed90 => (REGIONS as u32) << 8,
            0xed94 => self.control,
            0xed98 => self.number as u32,
            0xed9c => region.base | self.number as u32,
            0xeda0 => region.attributes,
            _ => return None,
        })
    }

    pub(crate) fn write_mpu(&mut self, offset: u32, value: u32) -> Option<()> {
        match offset {
            0xed94 => self.control = value,
            0xed98 => self.number = value as usize & 0xff,
            0xed9c => {
                // VALID: the region's number is told along.
                if value & 0x10 != 0 {
                    self.number = value as usize & 0xf;
                }
                self.regions.get_mut(self.number)?.base = value & !0x1f;
            }
            0xeda0 => self.regions.get_mut(self.number)?.attributes = value,
            _ => return None,
        }
        Some(())
    }

    /// Whether the data cache may hold what is at `address`: DMA does not see what the program has written there, nor the program
    /// what DMA has.
    pub(crate) fn holds(&self, address: u32) -> bool {
        if !self.data || DTCM.contains(&address) {
            return false;
        }
        let region = self.regions.iter().rfind(|region| region.contains(address));
        match region.filter(|_| self.control & 1 != 0) {
            Some(region) => region.is_cached(),
            // Where no region is: code, SRAM and external RAM are cached.
            None => matches!(address >> 29, 0 | 1 | 3 | 4),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Caches, DATA, INSTRUCTIONS};

    const SRAM: u32 = 0x2400_0000;

    #[test]
    fn the_data_cache_holds_what_no_region_excludes() {
        let mut caches = Caches::default();
        assert!(!caches.holds(SRAM));
        caches.control(DATA);
        assert!(caches.holds(SRAM) && !caches.holds(0x2000_0000) && !caches.holds(0x4000_0000));
        // The first 64 KiB: normal, not cached.
        caches.write_mpu(0xed98, 0).unwrap();
        caches.write_mpu(0xed9c, SRAM).unwrap();
        caches.write_mpu(0xeda0, 3 << 24 | 1 << 19 | 15 << 1 | 1).unwrap();
        assert!(caches.holds(SRAM), "the MPU is off");
        caches.write_mpu(0xed94, 5).unwrap();
        assert!(!caches.holds(SRAM) && !caches.holds(SRAM + 0xffff) && caches.holds(SRAM + 0x1_0000));
        // All of it, but its first eighth: write-back.
        caches.write_mpu(0xed9c, SRAM | 0x11).unwrap();
        caches.write_mpu(0xeda0, 3 << 24 | 1 << 19 | 3 << 16 | 1 << 8 | 15 << 1 | 1).unwrap();
        assert!(!caches.holds(SRAM) && caches.holds(SRAM + 0x2000));
    }

    #[test]
    fn an_instruction_cache_is_emptied_before_it_is_on() {
        let mut caches = Caches::default();
        caches.empty();
        caches.control(INSTRUCTIONS);
        assert_eq!(caches.broken_rule, None);
        caches.change_instructions();
        assert!(caches.broken_rule.take().is_some());
        caches.control(INSTRUCTIONS);
        assert!(caches.broken_rule.is_some());
    }
}
