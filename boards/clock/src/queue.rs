//! The calling thread's alarms: one for every waker that waits for a time.
//!
//! A waker has at most one alarm, the earliest. Whoever is woken polls its timers again and each leaves its time
//! anew, so nothing is lost, and a timer that is set again and again (an idle time-out) does not pile up.

use std::cell::RefCell;
use std::task::Waker;

use embassy_time_driver::now;

struct Alarm {
    at: u64,
    waker: Waker,
}

/// A thread's alarms.
pub(crate) struct Alarms {
    /// Unordered: a thread has some tens of tasks, and looking through them is cheaper than keeping them sorted.
    set: Vec<Alarm>,
    /// The earliest one's tick; the last tick there is when there is none.
    earliest: u64,
}

impl Alarms {
    /// None.
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
                // Who sets alarms often comes to the front, a place each time.
                set.swap(index.saturating_sub(1), index);
            }
            None => set.push(Alarm { at, waker: waker.clone() }),
        }
    });
}

/// The tick of this thread's earliest alarm.
pub fn next_alarm() -> Option<u64> {
    ALARMS.with_borrow(|alarms| (alarms.earliest < u64::MAX).then_some(alarms.earliest))
}

/// Wakes everything of this thread whose time has come.
pub fn fire_due() {
    let Some(earliest) = next_alarm() else { return };
    let now = now();
    if earliest > now {
        return;
    }
    // Woken outside of the borrow: a waker may run code that sets the next alarm.
    let due: Vec<Waker> = ALARMS.with_borrow_mut(|Alarms { set, earliest }| {
        let due = set.extract_if(.., |alarm| alarm.at <= now).map(|alarm| alarm.waker).collect();
        *earliest = set.iter().map(|alarm| alarm.at).min().unwrap_or(u64::MAX);
        due
    });
    due.into_iter().for_each(Waker::wake);
}

/// Puts `alarms` in place of the thread's present ones, which are returned.
pub(crate) fn replace(alarms: Alarms) -> Alarms {
    ALARMS.replace(alarms)
}
