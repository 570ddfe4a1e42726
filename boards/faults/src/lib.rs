//! What a Cortex-M board keeps over a reset: what it reports after a panic or a fault, shown by `show log`, and the audit trail.
//!
//! Each board has its own handlers, which [`note`] the reason and restart it.
#![no_std]

mod calls;
// Images without an audit trail have no memory for it.
#[cfg(feature = "audit")]
mod kept;

use core::arch::asm;
use core::cell::UnsafeCell;
use core::fmt;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m_rt::ExceptionFrame;
use mobgate_board::last_words::{LastWords, WORDS_BYTES_MAX};

#[cfg(feature = "audit")]
pub use crate::kept::audit_memory;

struct Kept(UnsafeCell<MaybeUninit<LastWords>>);

// SAFETY: accessed only inside critical sections and in the fault handlers, which never return.
unsafe impl Sync for Kept {}

/// In memory that neither a reset nor the start-up code clears.
#[unsafe(link_section = ".uninit.LAST_WORDS")]
static LAST_WORDS: Kept = Kept(UnsafeCell::new(MaybeUninit::uninit()));

fn with_last_words<R>(f: impl FnOnce(&mut LastWords) -> R) -> R {
    // SAFETY: any content is a valid `LastWords`; see `Kept` for why access is exclusive.
    critical_section::with(|_| f(unsafe { (*LAST_WORDS.0.get()).assume_init_mut() }))
}

/// Written to flush the last words out of the ECC buffer, see [`note`]. Used, because stores to what nobody reads are left out.
#[used]
#[unsafe(link_section = ".uninit.PUSH")]
static PUSH: AtomicU32 = AtomicU32::new(0);

/// Records why the run ends, for the next start.
pub fn note(words: fmt::Arguments<'_>) {
    with_last_words(|last| last.write(words));
    // The H7's RAM has ECC over 64-bit words: half a word waits in a buffer until another word is written, and a reset would lose
    // it (AN5342, 2.2).
    for _ in 0..2 {
        PUSH.store(0, Ordering::Relaxed);
        cortex_m::asm::dsb();
    }
}

/// Takes the record of the last run.
pub fn take() -> Option<heapless::String<WORDS_BYTES_MAX>> {
    with_last_words(LastWords::take)
}

/// A fault as its handler sees it: where the program was, and the address it accessed.
pub struct Fault<'f>(pub &'f ExceptionFrame);

impl fmt::Display for Fault<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(frame) = self;
        let what = status::Status::read();
        write!(f, "fault{what} at {:#010x}, called from {:#010x}{}", frame.pc(), frame.lr(), what.access())
    }
}

/// Most calls of a panic that are recorded: what [`WORDS_BYTES_MAX`] has room for.
const CALLS_MAX: usize = 12;

/// A panic as its handler sees it: the calls that led to it, innermost first. The texts of messages and places, and what formats
/// them, would take a tenth of the flash; `addr2line` finds the place in the image's file.
pub struct Panic {
    /// The handler's frame.
    frame: u32,
}

impl Panic {
    /// To be called by the handler.
    #[inline(always)] // the frame is that of the caller
    pub fn here() -> Self {
        let frame;
        // SAFETY: reads a register.
        unsafe { asm!("mov {}, r7", out(reg) frame, options(nomem, nostack, preserves_flags)) };
        Self { frame }
    }
}

impl fmt::Display for Panic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("panic after calls at")?;
        calls::behind(self.frame).take(CALLS_MAX).try_for_each(|call| write!(f, " {call:#010x}"))
    }
}

// ARMv7-M, which has atomic operations, also has registers that tell what a fault was; ARMv6-M has neither.
#[cfg_attr(not(target_has_atomic = "32"), path = "no_status.rs")]
mod status;
