//! Memory-mapped registers.

/// A 32-bit register, by its address.
#[derive(Clone, Copy)]
pub(crate) struct Register(usize);

impl Register {
    /// The register at `offset` from a device's `base`. Only for registers in the AN386 application note: QEMU aborts on any other
    /// access.
    pub(crate) const fn at(base: usize, offset: usize) -> Self {
        Self(base + offset)
    }

    pub(crate) fn read(self) -> u32 {
        // SAFETY: a device register, see `at`; reading one does not touch Rust's memory.
        unsafe { (self.0 as *const u32).read_volatile() }
    }

    pub(crate) fn write(self, value: u32) {
        // SAFETY: as above. No device of this board reads or writes memory by itself.
        unsafe { (self.0 as *mut u32).write_volatile(value) }
    }
}
