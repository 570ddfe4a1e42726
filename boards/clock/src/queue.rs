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

thread_local! {
    /// Unordered: a thread has some tens of tasks, and looking through them is cheaper than keeping them sorted.
    static ALARMS: RefCell<Vec<Alarm>> = const { RefCell::new(Vec::new()) };
}

/// Sets `waker`'s alarm to `at`, unless an earlier one is set.
pub(crate) fn insert(at: u64, waker: &Waker) {
    ALARMS.with_borrow_mut(|alarms| match alarms.iter().position(|alarm| alarm.waker.will_wake(waker)) {
        Some(index) => {
            alarms[index].at = alarms[index].at.min(at);
            // Who sets an alarm sets it again soon.
            alarms.swap(0, index);
        }
        None => alarms.push(Alarm { at, waker: waker.clone() }),
    });
}

/// The tick of this thread's earliest alarm.
pub fn next_alarm() -> Option<u64> {
    ALARMS.with_borrow(|alarms| alarms.iter().map(|alarm| alarm.at).min())
}

/// Wakes everything of this thread whose time has come.
pub fn fire_due() {
    let now = now();
    if next_alarm().is_none_or(|at| at > now) {
        return;
    }
    // Woken outside of the borrow: a waker may run code that sets the next alarm.
    let due: Vec<Waker> = ALARMS.with_borrow_mut(|alarms| {
        alarms.extract_if(.., |alarm| alarm.at <= now).map(|alarm| alarm.waker).collect()
    });
    due.into_iter().for_each(Waker::wake);
}

/// Puts `alarms` in place of the thread's present ones, which are returned.
pub(crate) fn replace(alarms: Alarms) -> Alarms {
    Alarms(ALARMS.replace(alarms.0))
}

/// A thread's alarms, set aside.
#[derive(Default)]
pub(crate) struct Alarms(Vec<Alarm>);
