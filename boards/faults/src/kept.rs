//! The audit trail's memory, which neither a reset nor the start-up code clears.

use core::mem::MaybeUninit;

use mobgate::gateway::audit::AuditMemory;

#[unsafe(link_section = ".uninit.AUDIT")]
static AUDIT: MaybeUninit<AuditMemory> = MaybeUninit::uninit();

/// The memory of the audit trail.
pub const fn audit_memory() -> &'static AuditMemory {
    // SAFETY: any content is a valid `AuditMemory`.
    unsafe { AUDIT.assume_init_ref() }
}
