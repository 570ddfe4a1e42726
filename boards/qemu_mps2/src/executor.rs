//! Embassy's executor, sleeping in WFI.
//!
//! embassy-executor's own one for Cortex-M sleeps in WFE, which QEMU treats as a yield: it would keep a host CPU busy.

use core::ptr::null_mut;
use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m::asm::wfi;
use cortex_m::interrupt;
use embassy_executor::{Spawner, raw};
use static_cell::StaticCell;

use crate::measure::Busy;

/// A task was woken.
static WORK: AtomicBool = AtomicBool::new(false);

/// Called by the executor when its run queue becomes non-empty.
#[unsafe(export_name = "__pender")]
fn pender(_context: *mut ()) {
    WORK.store(true, Ordering::Relaxed);
}

/// Runs the tasks that `init` spawns; never returns.
pub(crate) fn run(init: impl FnOnce(Spawner)) -> ! {
    static EXECUTOR: StaticCell<raw::Executor> = StaticCell::new();
    let executor = EXECUTOR.init(raw::Executor::new(null_mut()));
    init(executor.spawner());
    let mut busy = Busy::begin();
    loop {
        // With interrupts masked, no task can be woken between the check and the sleep; a pending interrupt still ends WFI.
        interrupt::disable();
        let has_work = WORK.load(Ordering::Relaxed);
        if has_work {
            WORK.store(false, Ordering::Relaxed);
        } else {
            busy.fall_asleep();
            wfi();
            busy.wake_up();
        }
        // SAFETY: no critical section is active in the outermost loop.
        unsafe { interrupt::enable() };
        if has_work {
            // SAFETY: called only here, in the thread that made the executor, never from a task.
            busy.in_tasks(|| unsafe { executor.poll() });
        }
    }
}
