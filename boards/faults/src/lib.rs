//! What a board with a Cortex-M says after a panic or a fault: written down, kept over the reset, shown by `show log`.
//!
//! A board has the handlers of its own, which [`note`] why the run ends and start it again.
#![no_std]

use core::cell::UnsafeCell;
use core::fmt;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::SCB;
use cortex_m_rt::ExceptionFrame;
use mobgate_board::last_words::{LastWords, WORDS_BYTES_MAX};

/// CFSR.BFARVALID and CFSR.MMARVALID: the address whose access has failed is known (ARMv7-M architecture, B3.2.15).
const BUS_ADDRESS_VALID: u32 = 1 << 15;
const MEMORY_ADDRESS_VALID: u32 = 1 << 7;

struct Kept(UnsafeCell<MaybeUninit<LastWords>>);

// SAFETY: it is touched inside critical sections only, and in the fault handlers, behind which nothing comes.
unsafe impl Sync for Kept {}

/// In memory that neither a reset nor the start-up code clears.
#[unsafe(link_section = ".uninit.LAST_WORDS")]
static LAST_WORDS: Kept = Kept(UnsafeCell::new(MaybeUninit::uninit()));

fn with_last_words<R>(f: impl FnOnce(&mut LastWords) -> R) -> R {
    // SAFETY: any content is a valid `LastWords`; see `Kept` for why nobody else has it.
    critical_section::with(|_| f(unsafe { (*LAST_WORDS.0.get()).assume_init_mut() }))
}

/// Pushes the last words into the memory cells, see [`note`].
#[unsafe(link_section = ".uninit.PUSH")]
static PUSH: AtomicU32 = AtomicU32::new(0);

/// Writes down why the run ends, for the next start.
pub fn note(words: fmt::Arguments<'_>) {
    with_last_words(|last| last.write(words));
    // The H7's memory corrects errors in words of 64 bits: half a word waits in a buffer for the next write to another one,
    // and a reset would lose it (AN5342, 2.2).
    for _ in 0..2 {
        PUSH.store(0, Ordering::Relaxed);
        cortex_m::asm::dsb();
    }
}

/// What the last run wrote down, once.
pub fn take() -> Option<heapless::String<WORDS_BYTES_MAX>> {
    with_last_words(LastWords::take)
}

/// A fault, as its handler finds it: where the program was, and what it touched.
pub struct Fault<'f>(pub &'f ExceptionFrame);

impl fmt::Display for Fault<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // SAFETY: reading these registers has no effect.
        let (status, bus, memory) = unsafe {
            let scb = &*SCB::PTR;
            (scb.cfsr.read(), scb.bfar.read(), scb.mmfar.read())
        };
        let Self(frame) = self;
        write!(f, "fault {status:#010x} at {:#010x}, called from {:#010x}", frame.pc(), frame.lr())?;
        match status {
            _ if status & BUS_ADDRESS_VALID != 0 => write!(f, ", by access to {bus:#010x}"),
            _ if status & MEMORY_ADDRESS_VALID != 0 => write!(f, ", by access to {memory:#010x}"),
            _ => Ok(()),
        }
    }
}
