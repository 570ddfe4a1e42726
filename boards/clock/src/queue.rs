//! The calling thread's alarms: at most one per waker.
//!
//! A waker keeps only its earliest alarm. A woken task polls all its timers, and each schedules itself again, so nothing is lost,
//! and a timer that is reset often (an idle time-out) does not pile up.

use std::cell::RefCell;
use std::task::Waker;

use embassy_time_driver::now;

struct Alarm {
    at: u64,
    waker: Waker,
}

/// A thread's alarms.
pub(crate) struct Alarms {
    /// Unordered: a thread has some tens of tasks, and a linear search is cheaper than sorting.
    set: Vec<Alarm>,
    /// Tick of the earliest alarm; `u64::MAX` if there is none.
    earliest: u64,
}

impl Alarms {
    /// No alarms.
    pub(crate) const NONE: Self = Self { set: Vec::new(), earliest: u64::MAX };
}

thread_local! {
    static ALARMS: RefCell<Alarms> = const { RefCell::new(Alarms::NONE) };
}

/// Sets `waker`'s alarm to `at`, unless an earlier one is set.
pub(crate) fn insert(at: u64, waker: &Waker) {
    ALARMS.with_borrow_mut(|Alarms { set, earliest }| {
        *earliest = at.min(*earliest);
        match set.iter().position(|alarm| alarm.waker.will_wake(waker)) {
            Some(index) => {
                set[index].at = set[index].at.min(at);
                // Frequently used wakers move to the front, one step per call.
                if index > 0 {
                    set.swap(index - 1, index);
                }
            }
            None => set.push(Alarm { at, waker: waker.clone() }),
        }
    });
}

/// The tick of this thread's earliest alarm.
pub fn next_alarm() -> Option<u64> {
    ALARMS.with_borrow(|alarms| (alarms.earliest < u64::MAX).then_some(alarms.earliest))
}

/// Wakes all tasks of this thread that are due.
pub fn fire_due() {
    let Some(earliest) = next_alarm() else { return };
    let now = now();
    if earliest > now {
        return;
    }
    // Woken outside the borrow: a waker may run code that sets the next alarm.
    let due: Vec<Waker> = ALARMS.with_borrow_mut(|Alarms { set, earliest }| {
        let due = set.extract_if(.., |alarm| alarm.at <= now).map(|alarm| alarm.waker).collect();
        *earliest = set.iter().map(|alarm| alarm.at).min().unwrap_or(u64::MAX);
        due
    });
    due.into_iter().for_each(Waker::wake);
}

/// Replaces the thread's alarms and returns the old ones.
pub(crate) fn replace(alarms: Alarms) -> Alarms {
    ALARMS.replace(alarms)
}
