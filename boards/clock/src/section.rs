//! The critical section of hosts: one lock for the whole process, which its owner may take again.
//!
//! Nearly everything runs in one thread and takes this lock some hundred times for a transaction, so it is a flag for the
//! thread and one atomic exchange; other threads hold it for a few instructions only, to wake a task.

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

// SAFETY: between `acquire` and the `release` that belongs to it no other thread gets past `acquire`: `TAKEN` is true, and only its
// owner makes it false. What an owner wrote is seen by the next one, by the order of release and acquire.
unsafe impl critical_section::Impl for Section {
    unsafe fn acquire() -> RawRestoreState {
        if OWNED.replace(true) {
            return true;
        }
        while TAKEN.swap(true, Ordering::Acquire) {
            // Its owner may be waiting for a processor.
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
                            // Taken once more inside, and kept until the outer one ends.
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
