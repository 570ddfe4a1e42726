//! Random worlds, one after the other, and what they have in common.

use std::cell::Cell;
use std::rc::Rc;

use embassy_time::Duration;

use crate::fault::When;
use crate::net::Path;
use crate::random::each_seed;
use crate::{Device, Fault, Faults, Random};

/// So few requests are too few to tell: they come from few worlds, and those differ more than the requests in them.
const REQUESTS_MIN: u32 = 5_500;

/// The register of each device from which on it says what the time is.
pub const FRESH: u16 = 100;

/// Lets the worlds of the first `worlds` seeds `live`, or as many as the environment says (see [`each_seed`]): whatever happens in them,
/// at least `least` per cent of the requests that they count get their response. A gateway that refuses everything gives no wrong
/// answer either.
///
/// # Panics
/// When fewer do, unless there were too few requests to tell.
pub fn torture(name: &str, least: f64, worlds: u64, mut live: impl FnMut(u64, &Share)) {
    let share = Share::default();
    each_seed(worlds, |seed| live(seed, &share));
    share.demand(name, least);
}

/// A device that has one of at most `most` faults, each as `draw` says, in fewer than `per_cent` of the cases. It tells what the time is at [`FRESH`].
pub fn draw_device(
    random: &mut Random,
    unit: u8,
    (most, per_cent): (usize, usize),
    mut draw: impl FnMut(&mut Random) -> Fault,
) -> Device {
    let mut faults = Faults::new(random.bits());
    for _ in 0..random.index(most + 1) {
        let fault = draw(random);
        faults = faults.with(When::Chance(random.index(per_cent) as f64 / 100.0), fault);
    }
    // Many devices refuse diagnostics.
    if random.chance(0.3) {
        faults = faults.with(When::Function(8), Fault::Exception(1));
    }
    let turnaround = Duration::from_micros(random.within(0..=20_000));
    Device::new(unit).with_fresh(FRESH).with_turnaround(turnaround).with_faults(faults)
}

/// A way through the network.
pub fn draw_path(random: &mut Random) -> Path {
    Path {
        latency: Duration::from_micros(random.within(1..=5_000)),
        piece_bytes_max: [None, Some(1), Some(7)][random.index(3)],
        piece_spacing: Duration::from_micros(random.within(1..=500)),
        coalesce: Duration::from_micros(random.within(0..=2_000)),
        ..Path::default()
    }
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

    /// Prints the share as the figure `name`, in per cent, which is at least `least`.
    fn demand(&self, name: &str, least: f64) {
        let [answered, asked] = self.0.get();
        let share = 100.0 * f64::from(answered) / f64::from(asked.max(1));
        let verdict = if share >= least { "ok" } else { "short" };
        println!("figure {name} {share:.2} % >={least} {verdict}");
        assert!(asked < REQUESTS_MIN || share >= least, "{answered} of {asked} requests were answered");
    }
}
