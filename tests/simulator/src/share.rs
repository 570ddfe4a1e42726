//! How many of the requests that could be answered were: a gateway that refuses everything gives no wrong response either.

use std::cell::Cell;
use std::rc::Rc;

use crate::random::each_seed;

/// So few requests are too few to tell: they come from few worlds, and those differ more than the requests in them.
const REQUESTS_MIN: u32 = 5_500;

/// Lets the worlds of `count` seeds live. Of the requests of all worlds together at least `least` per cent must have got their
/// response, which is the figure `name`.
pub fn each_world(count: u64, name: &str, least: f64, mut live: impl FnMut(u64, &Share)) {
    let share = Share::default();
    each_seed(count, |seed| live(seed, &share));
    share.demand(name, least);
}

/// Counts requests to devices that there are. Clones count together.
#[derive(Debug, Clone, Default)]
pub struct Share(Rc<Cell<[u32; 2]>>);

impl Share {
    /// Counts a request and whether it got its response.
    pub fn count(&self, good: bool) {
        self.add(u32::from(good), 1);
    }

    /// Counts requests, and how many of them got their response.
    pub fn add(&self, good: u32, all: u32) {
        let [answered, asked] = self.0.get();
        self.0.set([answered + good, asked + all]);
    }

    /// Prints the share as the figure `name`, in per cent; it must be `least`, unless there were too few requests to tell.
    pub fn demand(&self, name: &str, least: f64) {
        let [answered, asked] = self.0.get();
        let share = 100.0 * f64::from(answered) / f64::from(asked.max(1));
        let verdict = if share >= least { "ok" } else { "short" };
        println!("figure {name} {share:.2} % >={least} {verdict}");
        assert!(asked < REQUESTS_MIN || share >= least, "{answered} of {asked} requests were answered");
    }
}
