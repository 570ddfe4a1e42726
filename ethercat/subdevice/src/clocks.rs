//! Distributed clocks: outputs take effect and inputs are sampled at the controller's SYNC signals, which all devices of a segment
//! have at the same time.
//!
//! The signals come by pins, not by the controller's interrupt: a processor that first had to ask the controller over its bus would
//! be late by a different time in each cycle. [`SyncSignals`] notes their edges; a
//! [`SubDevice`](crate::sub_device::SubDevice) that has them offers what its 1C32h and 1C33h say.
//!
//! In a cycle, the MainDevice's frame brings outputs, which are read at once and wait. At SYNC0 they take effect, and inputs are
//! sampled, for the next frame to fetch; where SYNC1 is active too, inputs are sampled at SYNC1. SYNC1 at every n-th SYNC0 makes the
//! cycle of the frames n times as long (subordinated cycles).

use core::cell::Cell;
use core::future::poll_fn;
use core::task::Poll;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::waitqueue::AtomicWaker;
use embassy_time::{Duration, Instant};

use crate::al_state::AlStatusCode;
use crate::esc::{Esc, EscError};
use crate::registers::{SYNC_CONTROL, SYNC_CYCLES};

/// Longest cycle of the frames, as the loss of SYNC0 is noticed some cycles later.
pub const CYCLE_NS_MAX: u32 = 1_000_000_000;
/// So many cycles without a pulse of SYNC0, and at least [`LOST_MIN`], mean that it is lost.
const LOST_CYCLES: u32 = 3;
/// Least time until SYNC0 counts as lost: tasks of a busy processor may come late.
const LOST_MIN: Duration = Duration::from_millis(3);
/// So many cycles in a row must have outputs and SYNC0 before Op is entered.
const CYCLES_TO_OP: u8 = 3;
/// What a bad cycle adds to the counter of 10F1h:02; a good one takes 1 away (ETG.1020).
const BAD_CYCLE: u16 = 3;

/// Pulses of a signal that have not been served.
#[derive(Debug, Clone, Copy, Default)]
struct Pulses {
    count: u32,
    /// When the last one began.
    last: Option<Instant>,
}

/// The SYNC signals at the processor's pins: where the edges are noted, and a SubDevice waits for them. A `static` of the board.
pub struct SyncSignals {
    pulses: Mutex<CriticalSectionRawMutex, Cell<[Pulses; 2]>>,
    waker: AtomicWaker,
}

impl SyncSignals {
    /// Before the first pulse.
    pub const fn new() -> Self {
        const NONE: Pulses = Pulses { count: 0, last: None };
        Self { pulses: Mutex::new(Cell::new([NONE; 2])), waker: AtomicWaker::new() }
    }

    /// A pulse of SYNC0 begins. For the pin's interrupt handler, or a task that waits for its edges.
    pub fn sync0(&self) {
        self.note(0);
    }

    /// The same for SYNC1.
    pub fn sync1(&self) {
        self.note(1);
    }

    fn note(&self, nth: usize) {
        let last = Some(Instant::now());
        self.pulses.lock(|pulses| {
            let mut all = pulses.get();
            if let Some(one) = all.get_mut(nth) {
                *one = Pulses { count: one.count.saturating_add(1), last };
            }
            pulses.set(all);
        });
        self.waker.wake();
    }

    fn take(&self) -> [Pulses; 2] {
        self.pulses.lock(Cell::take)
    }

    /// Waits for a pulse; `None` has none.
    pub(crate) async fn pulsed(signals: Option<&Self>) {
        poll_fn(|context| {
            let Some(signals) = signals else { return Poll::Pending };
            signals.waker.register(context.waker());
            let pending = signals.pulses.lock(|pulses| pulses.get().iter().any(|one| one.count > 0));
            if pending { Poll::Ready(()) } else { Poll::Pending }
        })
        .await;
    }
}

impl Default for SyncSignals {
    fn default() -> Self {
        Self::new()
    }
}

/// Synchronisation types at SYNC0 and SYNC1, in 1C32h:04 and 1C33h:04.
pub(crate) const SYNC0_TYPE: u32 = 1 << 2;
pub(crate) const SYNC1_TYPE: u32 = 1 << 3;

/// What a device can do at SYNC signals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Offer {
    /// Outputs and inputs at SYNC0.
    pub sync0: bool,
    /// Inputs at SYNC1.
    pub sync1: bool,
}

/// The SYNC unit's settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct SyncUnit {
    control: u8,
    activation: u8,
    sync0_ns: u32,
    sync1_ns: u32,
}

/// A cycle of distributed clocks that the device can keep.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cycle {
    /// SYNC0's cycle (09A0h).
    pub sync0_ns: u32,
    /// Cycles of SYNC0 in one of the frames.
    pub subordinated: u32,
    /// From SYNC0 to SYNC1, if SYNC1 is active: inputs are sampled then.
    pub inputs_ns: Option<u32>,
}

impl SyncUnit {
    const BY_PROCESSOR: u8 = 1 << 0;
    const LATCHES_BY_PROCESSOR: u8 = 3 << 4;
    const ON: u8 = 1 << 0;
    const SYNC0: u8 = 1 << 1;
    const SYNC1: u8 = 1 << 2;

    pub(crate) async fn read(esc: &mut impl Esc) -> Result<Self, EscError> {
        let (mut control, mut cycles) = ([0; 2], [0; 8]);
        esc.read(SYNC_CONTROL, &mut control).await?;
        let [control, activation] = control;
        if activation & Self::ON != 0 {
            esc.read(SYNC_CYCLES, &mut cycles).await?;
        }
        let [a, b, c, d, e, f, g, h] = cycles;
        let (sync0_ns, sync1_ns) = (u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h]));
        Ok(Self { control, activation, sync0_ns, sync1_ns })
    }

    pub(crate) const fn is_on(&self) -> bool {
        self.activation & Self::ON != 0
    }

    /// The cycle that is set, if any; `shortest_ns` is what the device needs for process data.
    pub(crate) fn cycle(&self, offer: Offer, shortest_ns: u32) -> Result<Option<Cycle>, AlStatusCode> {
        let has = |bit| self.activation & bit != 0;
        // The device has nothing to latch.
        if self.control & Self::LATCHES_BY_PROCESSOR != 0 {
            return Err(AlStatusCode::InvalidLatchConfiguration);
        }
        if !self.is_on() {
            return Ok(None);
        }
        let offered = offer.sync0 && (offer.sync1 || !has(Self::SYNC1));
        if self.control & Self::BY_PROCESSOR != 0 || !has(Self::SYNC0) || !offered {
            return Err(AlStatusCode::InvalidDcConfiguration);
        }
        if self.sync0_ns < shortest_ns.max(1) {
            return Err(AlStatusCode::InvalidSync0Cycle);
        }
        let sync1_ns = if has(Self::SYNC1) { self.sync1_ns } else { 0 };
        let subordinated = sync1_ns / self.sync0_ns + 1;
        let cycle_ns = self.sync0_ns.checked_mul(subordinated).filter(|cycle_ns| *cycle_ns <= CYCLE_NS_MAX);
        if cycle_ns.is_none() {
            return Err(AlStatusCode::InvalidSyncCycle);
        }
        let inputs_ns = has(Self::SYNC1).then_some(sync1_ns % self.sync0_ns);
        Ok(Some(Cycle { sync0_ns: self.sync0_ns, subordinated, inputs_ns }))
    }
}

/// What has become due by pulses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Due {
    /// A pulse of SYNC0 began: outputs that came before take effect.
    pub(crate) outputs: bool,
    /// Inputs are sampled.
    pub(crate) inputs: bool,
    /// A cycle of the frames has ended with this.
    pub(crate) ended: Option<Ended>,
}

/// How a cycle of the frames was.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ended {
    /// There was a frame, and each pulse was served.
    Good,
    /// No outputs had come.
    NoOutputs,
    /// The processor did not serve each pulse: the cycle is too short.
    Overrun,
}

/// The cycle in force, and how it is kept.
#[derive(Default)]
pub(crate) struct Clocks {
    pub(crate) signals: Option<&'static SyncSignals>,
    cycle: Option<Cycle>,
    /// The last pulse of SYNC0.
    last: Option<Instant>,
    /// When the outputs were read that have not taken effect.
    ready: Option<Instant>,
    /// Pulses in this cycle of the frames; whether it had outputs; whether one was not served.
    pulses: u32,
    came: bool,
    overrun: bool,
    in_step: u8,
    errors: u16,
}

impl Clocks {
    /// Switches to `cycle`, or none.
    pub(crate) fn start(&mut self, cycle: Option<Cycle>) {
        if let Some(signals) = self.signals {
            signals.take();
        }
        *self = Self { signals: self.signals, cycle, ..Self::default() };
    }

    /// The signals to wait for.
    pub(crate) fn awaited(&self) -> Option<&'static SyncSignals> {
        self.signals.filter(|_| self.cycle.is_some())
    }

    /// Whether distributed clocks are in use.
    pub(crate) fn are_used(&self) -> bool {
        self.cycle.is_some()
    }

    /// Outputs were read, and wait for SYNC0.
    pub(crate) fn outputs_ready(&mut self) {
        self.ready = Some(Instant::now());
    }

    /// Outputs are read again: until that is done there are none.
    pub(crate) fn outputs_change(&mut self) {
        self.ready = None;
    }

    /// Whether outputs wait for SYNC0.
    pub(crate) fn have_outputs(&self) -> bool {
        self.ready.is_some()
    }

    /// Op was requested, or left: cycles are counted anew.
    pub(crate) fn begin_op(&mut self) {
        (self.in_step, self.errors) = (0, 0);
    }

    /// What pulses since the last call have made due. Outputs need not come if the device has none.
    pub(crate) fn take_due(&mut self, has_outputs: bool) -> Due {
        let (Some(cycle), Some(signals)) = (self.cycle, self.signals) else { return Due::default() };
        let [sync0, sync1] = signals.take();
        let sampled = if cycle.inputs_ns.is_some() { sync1 } else { sync0 };
        let mut due = Due { inputs: sampled.count > 0, ..Due::default() };
        let Some(at) = sync0.last else { return due };
        self.last = Some(at);
        // Those that were read later wait for the next pulse: they would take effect at any time.
        due.outputs = self.ready.take_if(|ready| *ready <= at).is_some();
        self.came |= due.outputs || !has_outputs;
        self.overrun |= sync0.count > 1;
        self.pulses = self.pulses.saturating_add(sync0.count);
        if self.pulses >= cycle.subordinated {
            due.ended = Some(match (self.overrun, self.came) {
                (true, _) => Ended::Overrun,
                (false, true) => Ended::Good,
                (false, false) => Ended::NoOutputs,
            });
            (self.pulses, self.came, self.overrun) = (0, false, false);
            self.count(due.ended == Some(Ended::Good));
        }
        due
    }

    fn count(&mut self, good: bool) {
        (self.in_step, self.errors) = match good {
            true => (self.in_step.saturating_add(1), self.errors.saturating_sub(1)),
            false => (0, self.errors.saturating_add(BAD_CYCLE)),
        };
    }

    /// The counter of synchronisation errors.
    pub(crate) fn errors(&self) -> u16 {
        self.errors
    }

    /// Whether frames and SYNC0 have come in step for long enough to enter Op.
    pub(crate) fn are_in_step(&self) -> bool {
        self.in_step >= CYCLES_TO_OP
    }

    /// When SYNC0 counts as lost if it does not come before.
    pub(crate) fn lost_at(&self) -> Option<Instant> {
        let cycle = self.cycle?;
        let limit = Duration::from_nanos(u64::from(cycle.sync0_ns) * u64::from(LOST_CYCLES));
        self.last.map(|last| last + limit.max(LOST_MIN))
    }

    /// Whether SYNC0 comes.
    pub(crate) fn are_alive(&self) -> bool {
        self.lost_at().is_some_and(|lost| Instant::now() < lost)
    }

    /// The next pulse of SYNC0, as it is expected.
    pub(crate) fn next(&self) -> Option<Instant> {
        Some(self.last? + Duration::from_nanos(self.cycle?.sync0_ns.into()))
    }
}

#[cfg(test)]
mod tests {
    use super::{CYCLE_NS_MAX, Cycle, Offer, SyncUnit};
    use crate::al_state::AlStatusCode;

    const BOTH: Offer = Offer { sync0: true, sync1: true };

    fn unit(control: u8, activation: u8, sync0_ns: u32, sync1_ns: u32) -> SyncUnit {
        SyncUnit { control, activation, sync0_ns, sync1_ns }
    }

    #[test]
    fn settings_that_the_device_cannot_keep_have_their_code() {
        let code = |unit: SyncUnit, offer| unit.cycle(offer, 200_000).unwrap_err();
        let only_sync0 = Offer { sync1: false, ..BOTH };
        for (unit, offer, expected) in [
            (unit(0, 3, 1_000_000, 0), Offer::default(), AlStatusCode::InvalidDcConfiguration),
            (unit(0, 1, 1_000_000, 0), BOTH, AlStatusCode::InvalidDcConfiguration),
            (unit(0, 5, 1_000_000, 0), BOTH, AlStatusCode::InvalidDcConfiguration),
            (unit(1, 3, 1_000_000, 0), BOTH, AlStatusCode::InvalidDcConfiguration),
            (unit(0, 7, 1_000_000, 0), only_sync0, AlStatusCode::InvalidDcConfiguration),
            (unit(0x10, 3, 1_000_000, 0), BOTH, AlStatusCode::InvalidLatchConfiguration),
            (unit(0x20, 0, 0, 0), BOTH, AlStatusCode::InvalidLatchConfiguration),
            (unit(0, 3, 199_999, 0), BOTH, AlStatusCode::InvalidSync0Cycle),
            (unit(0, 3, 0, 0), BOTH, AlStatusCode::InvalidSync0Cycle),
            (unit(0, 3, CYCLE_NS_MAX + 1, 0), BOTH, AlStatusCode::InvalidSyncCycle),
            (unit(0, 7, 500_000_000, 1_000_000_000), BOTH, AlStatusCode::InvalidSyncCycle),
            (unit(0, 7, 200_000, u32::MAX), BOTH, AlStatusCode::InvalidSyncCycle),
        ] {
            assert_eq!(code(unit, offer), expected, "{unit:?} {offer:?}");
        }
    }

    #[test]
    fn sync1_tells_when_inputs_are_sampled_and_how_many_cycles_a_frame_has() {
        let cycle = |unit: SyncUnit| unit.cycle(BOTH, 200_000).unwrap();
        assert_eq!(cycle(unit(0, 0, 1, 1)), None);
        assert_eq!(cycle(unit(0, 6, 1, 1)), None, "the unit is off");
        for (activation, sync1_ns, subordinated, inputs_ns) in [
            (3, 5_000_000, 1, None),
            (7, 0, 1, Some(0)),
            (7, 300_000, 1, Some(300_000)),
            (7, 3_000_000, 4, Some(0)),
            (7, 1_250_000, 2, Some(250_000)),
        ] {
            let expected = Cycle { sync0_ns: 1_000_000, subordinated, inputs_ns };
            assert_eq!(cycle(unit(0, activation, 1_000_000, sync1_ns)), Some(expected));
        }
    }
}
