//! The critical section for hosts: one reentrant lock for the whole process.
//!
//! Nearly all code runs in one thread, which takes this lock some hundred times per transaction, so it is a thread-local flag and
//! one atomic exchange. Other threads hold it for a few instructions only, to wake a task.

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use critical_section::RawRestoreState;

struct Section;

critical_section::set_impl!(Section);

static TAKEN: AtomicBool = AtomicBool::new(false);

thread_local! {
    static OWNED: Cell<bool> = const { Cell::new(false) };
}

// SAFETY: between `acquire` and its matching `release` no other thread gets past `acquire`: `TAKEN` is true, and only its owner
// clears it. Release/acquire ordering makes an owner's writes visible to the next one.
unsafe impl critical_section::Impl for Section {
    unsafe fn acquire() -> RawRestoreState {
        if OWNED.replace(true) {
            return true;
        }
        while TAKEN.swap(true, Ordering::Acquire) {
            // The owner may be preempted.
            thread::yield_now();
        }
        false
    }

    unsafe fn release(owned_before: RawRestoreState) {
        if !owned_before {
            OWNED.set(false);
            TAKEN.store(false, Ordering::Release);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::sync::Arc;
    use std::thread;

    use critical_section::Mutex;

    #[test]
    fn threads_that_count_together_lose_no_count() {
        let count = Arc::new(Mutex::new(Cell::new(0)));
        let counters: Vec<_> = (0..4)
            .map(|_| {
                let count = count.clone();
                thread::spawn(move || {
                    for _ in 0..10_000 {
                        critical_section::with(|section| {
                            let count = count.borrow(section);
                            // Nested acquisition; held until the outermost release.
                            critical_section::with(|_| {});
                            count.set(count.get() + 1);
                        });
                    }
                })
            })
            .collect();
        counters.into_iter().for_each(|counter| counter.join().unwrap());
        assert_eq!(critical_section::with(|section| count.borrow(section).get()), 40_000);
    }
}
