//! Registers of the machine.

/// A register of 32 bits, by its address.
#[derive(Clone, Copy)]
pub(crate) struct Register(usize);

impl Register {
    /// The register at `offset` from a device's `base`. Only for what the AN386 application note has there: QEMU ends
    /// at any other access.
    pub(crate) const fn at(base: usize, offset: usize) -> Self {
        Self(base + offset)
    }

    pub(crate) fn read(self) -> u32 {
        // SAFETY: a device's register, see `at`; reading one touches no memory of Rust's.
        unsafe { (self.0 as *const u32).read_volatile() }
    }

    pub(crate) fn write(self, value: u32) {
        // SAFETY: as above. No device of this board reads or writes memory by itself.
        unsafe { (self.0 as *mut u32).write_volatile(value) }
    }
}
