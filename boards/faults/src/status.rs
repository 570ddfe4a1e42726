//! What an ARMv7-M processor tells about a fault.

use core::fmt;

use cortex_m::peripheral::SCB;

/// CFSR.BFARVALID and CFSR.MMARVALID: the address of the failed access is known (ARMv7-M architecture, B3.2.15).
const BUS_ADDRESS_VALID: u32 = 1 << 15;
const MEMORY_ADDRESS_VALID: u32 = 1 << 7;

/// The fault's status.
pub(crate) struct Status {
    status: u32,
    address: Option<u32>,
}

impl Status {
    pub(crate) fn read() -> Self {
        // SAFETY: reading these registers has no effect.
        let (status, bus, memory) = unsafe {
            let scb = &*SCB::PTR;
            (scb.cfsr.read(), scb.bfar.read(), scb.mmfar.read())
        };
        let address = match status {
            _ if status & BUS_ADDRESS_VALID != 0 => Some(bus),
            _ if status & MEMORY_ADDRESS_VALID != 0 => Some(memory),
            _ => None,
        };
        Self { status, address }
    }

    /// The failed access, if it is known.
    pub(crate) fn access(&self) -> impl fmt::Display {
        fmt::from_fn(|f| match self.address {
            Some(address) => write!(f, ", by access to {address:#010x}"),
            None => Ok(()),
        })
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, " {:#010x}", self.status)
    }
}
