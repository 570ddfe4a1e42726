//! Embassy's executor, which waits for interrupts by WFI.
//!
//! embassy-executor's own for Cortex-M waits by WFE, which QEMU takes for a yield: it would keep a processor of the host busy.

use core::ptr::null_mut;
use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m::asm::wfi;
use cortex_m::interrupt;
use embassy_executor::{Spawner, raw};
use static_cell::StaticCell;

use crate::measure::Busy;

/// A task has been woken.
static WORK: AtomicBool = AtomicBool::new(false);

/// Called by the executor when its run queue is no longer empty.
#[unsafe(export_name = "__pender")]
fn pender(_context: *mut ()) {
    WORK.store(true, Ordering::Relaxed);
}

/// Runs what `init` spawns, for ever.
pub(crate) fn run(init: impl FnOnce(Spawner)) -> ! {
    static EXECUTOR: StaticCell<raw::Executor> = StaticCell::new();
    let executor = EXECUTOR.init(raw::Executor::new(null_mut()));
    init(executor.spawner());
    let mut busy = Busy::begin();
    loop {
        // With interrupts masked nothing can be woken between the look and the sleep; a pending one ends WFI all the same.
        interrupt::disable();
        let has_work = WORK.load(Ordering::Relaxed);
        if has_work {
            WORK.store(false, Ordering::Relaxed);
        } else {
            busy.fall_asleep();
            wfi();
            busy.wake_up();
        }
        // SAFETY: no critical section is open: this is the outermost loop.
        unsafe { interrupt::enable() };
        if has_work {
            // SAFETY: here alone, in the thread that made it, and never from within a task.
            busy.in_tasks(|| unsafe { executor.poll() });
        }
    }
}
