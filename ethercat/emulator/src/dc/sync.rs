//! SYNC0 and SYNC1 (I, Distributed Clocks, "SyncSignals generation"; II, 0980h to 09A7h).

use crate::Nanos;
use crate::memory::Memory;
use crate::registers::{
    NEXT_SYNC1, PDI_CONFIG, PULSE_LENGTH, START_TIME, SYNC_ACTIVATION, SYNC_STATUS, SYNC0_CYCLE,
    SYNC0_STATUS, SYNC1_CYCLE, SYNC1_STATUS,
};

const UNIT_ON: u8 = 1 << 0;
/// A write of the start time switches the unit on.
const AUTOMATIC: u8 = 1 << 3;
/// In register 0984h: the start time was in the past.
const START_IMPLAUSIBLE: u8 = 1 << 2;
const PULSE_UNIT_NANOS: u64 = 10;

/// One of the two signals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SyncLine {
    /// The common cycle.
    Sync0 = 0,
    /// Follows SYNC0 with a delay, every time or every n-th time.
    Sync1 = 1,
}

impl SyncLine {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Sync0, Self::Sync1];

    const fn on(self) -> u8 {
        match self {
            Self::Sync0 => 1 << 1,
            Self::Sync1 => 1 << 2,
        }
    }

    /// In register 0151h: the pin is the signal's output, not a latch's input.
    pub(crate) const fn is_output(self) -> u8 {
        match self {
            Self::Sync0 => 1 << 2,
            Self::Sync1 => 1 << 6,
        }
    }

    /// In register 0151h: the signal is mapped to the AL event request.
    const fn is_event(self) -> u8 {
        match self {
            Self::Sync0 => 1 << 3,
            Self::Sync1 => 1 << 7,
        }
    }

    /// The register of its status; reading acknowledges.
    pub(crate) const fn status(self) -> u16 {
        match self {
            Self::Sync0 => SYNC0_STATUS,
            Self::Sync1 => SYNC1_STATUS,
        }
    }
}

/// One signal; its times are system times.
#[derive(Debug, Clone, Default)]
struct Signal {
    next: Option<u64>,
    period: u64,
    /// When the pulse ends, unless it waits for an acknowledgement.
    until: Option<u64>,
    high: bool,
    pulses: u64,
    /// Pulses since the chip was made, and the world time of the last.
    all: u64,
    last: Nanos,
}

impl Signal {
    fn start(&mut self, first: Option<u64>, period: u64) {
        (self.next, self.period, self.pulses) = (first, period, 0);
        if first.is_none() {
            (self.high, self.until) = (false, None);
        }
    }

    fn advance(&mut self, length: u64, time: u64, at: Nanos) {
        if let Some(due) = self.next.filter(|due| *due <= time) {
            let missed = (time - due).checked_div(self.period).unwrap_or(0);
            let last = due + missed * self.period;
            self.pulses = self.pulses.saturating_add(missed).saturating_add(1);
            self.all += missed + 1;
            self.last = at.saturating_sub(time - last);
            self.next = last.checked_add(self.period).filter(|_| self.period > 0);
            self.high = true;
            self.until = (length > 0).then_some(last.saturating_add(length));
        }
        if self.until.take_if(|until| *until <= time).is_some() {
            self.high = false;
        }
    }
}

/// The unit that generates both signals.
#[derive(Debug, Clone, Default)]
pub(crate) struct SyncUnit {
    signals: [Signal; 2],
    implausible: bool,
}

impl SyncUnit {
    /// Handles a write to the activation register at system time `time`. A start time in the past gives no pulse.
    pub(crate) fn activate(&mut self, memory: &Memory, time: u64) {
        let activation = memory.byte(SYNC_ACTIVATION);
        let start = memory.quad_word(START_TIME);
        let is_on = activation & UNIT_ON != 0 && activation & SyncLine::Sync0.on() != 0;
        self.implausible = is_on && start <= time;
        let start = (is_on && !self.implausible).then_some(start);
        let cycle = u64::from(memory.double_word(SYNC0_CYCLE));
        // The time from a SYNC0 pulse: a cycle and more leaves pulses of SYNC0 out.
        let delay = u64::from(memory.double_word(SYNC1_CYCLE));
        let pulses = delay.checked_div(cycle).unwrap_or(0) + 1;
        let [sync0, sync1] = &mut self.signals;
        sync0.start(start, cycle);
        let second = start.filter(|_| activation & SyncLine::Sync1.on() != 0);
        sync1.start(second.map(|start| start.saturating_add(delay)), cycle * pulses);
    }

    /// Handles a write of the start time: whether it switches the unit on.
    pub(crate) fn starts_by_time(memory: &mut Memory) -> bool {
        let activation = memory.byte(SYNC_ACTIVATION);
        let starts = activation & AUTOMATIC != 0;
        if starts {
            memory.set_byte(SYNC_ACTIVATION, activation | UNIT_ON);
        }
        starts
    }

    /// Generates the pulses that are due at system time `time`, world time `at`.
    pub(crate) fn advance(&mut self, memory: &Memory, time: u64, at: Nanos) {
        let length = u64::from(memory.word(PULSE_LENGTH)) * PULSE_UNIT_NANOS;
        self.signals.iter_mut().for_each(|signal| signal.advance(length, time, at));
    }

    pub(crate) fn show(&self, memory: &mut Memory) {
        let mut status = if self.implausible { START_IMPLAUSIBLE } else { 0 };
        for ((line, signal), next) in SyncLine::ALL.iter().zip(&self.signals).zip([START_TIME, NEXT_SYNC1]) {
            if let Some(time) = signal.next {
                memory.put(next, &time.to_le_bytes());
            }
            status |= u8::from(signal.next.is_some() && signal.pulses == 0) << *line as u8;
            memory.set_byte(line.status(), u8::from(signal.high));
        }
        memory.set_byte(SYNC_STATUS, status);
    }

    /// The processor has read the status of `line`, which ends the pulse in acknowledge mode.
    pub(crate) fn acknowledge(&mut self, line: SyncLine) {
        let signal = &mut self.signals[line as usize];
        signal.high &= signal.until.is_some();
    }

    /// Whether `line` is an event to the processor now.
    pub(crate) fn is_event(&self, memory: &Memory, line: SyncLine) -> bool {
        self.signals[line as usize].high && memory.byte(PDI_CONFIG + 1) & line.is_event() != 0
    }

    /// Pulses of `line` since the activation.
    pub(crate) fn pulses(&self, line: SyncLine) -> u64 {
        self.signals[line as usize].pulses
    }

    /// All pulses at the pin of `line`, and the world time of the last one.
    pub(crate) fn at_pin(&self, line: SyncLine) -> (u64, Nanos) {
        let signal = &self.signals[line as usize];
        (signal.all, signal.last)
    }

    /// System time of the next change.
    pub(crate) fn next(&self) -> Option<u64> {
        self.signals.iter().flat_map(|signal| [signal.next, signal.until]).flatten().min()
    }
}
