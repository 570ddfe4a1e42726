//! The calls that led to a place, along the frame pointers, which every function keeps on these targets.

use core::iter::from_fn;
use core::ptr::addr_of;

unsafe extern "C" {
    // Of cortex-m-rt's linker script: where the stack begins, from where it grows down.
    static _stack_start: u32;
}

/// The addresses of the calls that led to the function whose frame this is, innermost first. A frame begins with that of the caller,
/// which lies higher, and the return address (AAPCS32, 6.2.1.4).
pub(crate) fn behind(mut frame: u32) -> impl Iterator<Item = u32> {
    let end = addr_of!(_stack_start).addr() as u32 - 8;
    from_fn(move || {
        if !frame.is_multiple_of(4) || frame > end {
            return None;
        }
        // SAFETY: both words lie on the stack in use, which any value may be read from: frames begin at that of a function that runs, and
        // lie higher and higher.
        let [before, back] = unsafe { (frame as *const [u32; 2]).read_volatile() };
        frame = if before > frame { before } else { u32::MAX };
        // Without the bit that says Thumb, and in the call, not behind it.
        Some((back & !1).wrapping_sub(2))
    })
}
