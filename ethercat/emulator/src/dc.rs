//! Distributed clocks (I, Distributed Clocks; II, 0900h to 09FFh), as far as a MainDevice's start-up needs them: receive times,
//! system time, drift control, SYNC0.

use crate::Nanos;
use crate::memory::Memory;
use crate::registers::{
    PDI_CONFIG, PULSE_LENGTH, RECEIVE_TIME_UNIT, RECEIVE_TIMES, START_TIME, SYNC_ACTIVATION, SYNC_STATUS,
    SYNC0_CYCLE, SYNC0_STATUS, SYSTEM_TIME, TIME_DELAY, TIME_DIFFERENCE, TIME_OFFSET,
};

const UNIT_ON: u8 = 1;
const SYNC0_ON: u8 = 1 << 1;
/// In register 0151h: SYNC0 is mapped to the AL event request.
const SYNC0_IS_EVENT: u8 = 1 << 3;
const PULSE_UNIT_NANOS: u64 = 10;

/// A chip's clock and its SYNC0 unit.
#[derive(Debug, Clone, Default)]
pub(crate) struct Clock {
    /// Clock value at world time 0: no two chips are powered on at the same time.
    pub(crate) start: Nanos,
    /// Rate deviation from world time, in parts per million.
    pub(crate) drift_ppm: i64,
    /// Correction accumulated by the control loop.
    correction: i64,
    next_pulse: Option<Nanos>,
    event_until: Option<Nanos>,
    event: bool,
    pulses: u64,
}

impl Clock {
    /// The local clock at a world time.
    fn local(&self, at: Nanos) -> i64 {
        let drift = at as i64 * self.drift_ppm / 1_000_000;
        ((self.start + at) as i64 + drift).wrapping_add(self.correction)
    }

    fn system(&self, memory: &Memory, at: Nanos) -> u64 {
        self.local(at).wrapping_add(memory.quad_word(TIME_OFFSET) as i64) as u64
    }

    /// System time as the MainDevice reads it: when the frame passed the reference clock.
    pub(crate) fn show(&self, memory: &mut Memory, at: Nanos) {
        let delay = u64::from(memory.double_word(TIME_DELAY));
        let time = self.system(memory, at).wrapping_sub(delay);
        memory.put(SYSTEM_TIME, &time.to_le_bytes());
        if let Some(next) = self.next_pulse {
            memory.put(START_TIME, &next.to_le_bytes());
        }
        memory.set_byte(SYNC_STATUS, u8::from(self.next_pulse.is_some() && self.pulses == 0));
        memory.set_byte(SYNC0_STATUS, u8::from(self.event));
    }

    /// System time as the processor reads it.
    pub(crate) fn show_processor(&self, memory: &mut Memory, at: Nanos) {
        let time = self.system(memory, at);
        memory.put(SYSTEM_TIME, &time.to_le_bytes());
    }

    /// Latches a frame's receive time at each port.
    pub(crate) fn latch(&self, memory: &mut Memory, ports: [Option<Nanos>; 4]) {
        for (port, at) in (0..).zip(ports) {
            let time = at.map_or(0, |at| self.local(at) as u64);
            memory.put(RECEIVE_TIMES + 4 * port, &(time as u32).to_le_bytes());
        }
        let unit = ports[0].map_or(0, |at| self.local(at) as u64);
        memory.put(RECEIVE_TIME_UNIT, &unit.to_le_bytes());
    }

    /// Compares the low half of the clock with the reference's time, and corrects half of the difference.
    pub(crate) fn compare(&mut self, memory: &mut Memory, reference: u32, at: Nanos) {
        let delay = memory.double_word(TIME_DELAY);
        let own = (self.system(memory, at) as u32).wrapping_sub(delay);
        let ahead = own.wrapping_sub(reference) as i32;
        self.correction = self.correction.wrapping_sub(i64::from(ahead) / 2);
        let sign = if ahead < 0 { 1 << 31 } else { 0 };
        memory.put(TIME_DIFFERENCE, &(ahead.unsigned_abs() | sign).to_le_bytes());
    }

    /// Handles a write to the activation register. A start time in the past gives no pulse.
    pub(crate) fn activate(&mut self, memory: &Memory, at: Nanos) {
        let wanted = memory.byte(SYNC_ACTIVATION) & (UNIT_ON | SYNC0_ON) == UNIT_ON | SYNC0_ON;
        let start = memory.quad_word(START_TIME);
        self.next_pulse = (wanted && start > self.system(memory, at)).then_some(start);
        self.pulses = 0;
        if !wanted {
            self.event = false;
        }
    }

    /// Generates the pulses that are due.
    pub(crate) fn advance(&mut self, memory: &Memory, at: Nanos) {
        let time = self.system(memory, at);
        if let Some(due) = self.next_pulse.filter(|due| *due <= time) {
            let cycle = u64::from(memory.double_word(SYNC0_CYCLE));
            let missed = (time - due).checked_div(cycle).unwrap_or(0);
            let last = due + missed * cycle;
            self.pulses = self.pulses.saturating_add(missed).saturating_add(1);
            self.next_pulse = last.checked_add(cycle).filter(|_| cycle > 0);
            let length = u64::from(memory.word(PULSE_LENGTH)) * PULSE_UNIT_NANOS;
            self.event = memory.byte(PDI_CONFIG + 1) & SYNC0_IS_EVENT != 0;
            self.event_until = (length > 0).then_some(last.saturating_add(length));
        }
        if self.event_until.take_if(|until| *until <= time).is_some() {
            self.event = false;
        }
    }

    /// The processor has read the SYNC0 status, which ends the event in acknowledge mode.
    pub(crate) fn acknowledge(&mut self) {
        if self.event_until.is_none() {
            self.event = false;
        }
    }

    pub(crate) fn sync0_event(&self) -> bool {
        self.event
    }

    /// SYNC0 pulses since the activation.
    pub(crate) fn pulses(&self) -> u64 {
        self.pulses
    }

    /// World time of the next change; rather early than late if the clock drifts.
    pub(crate) fn next(&self, memory: &Memory, at: Nanos) -> Option<Nanos> {
        let next = [self.next_pulse, self.event_until].into_iter().flatten().min()?;
        Some(at.saturating_add(next.saturating_sub(self.system(memory, at))))
    }
}
