//! LATCH0 and LATCH1 (I, Distributed Clocks, "LatchSignals"; II, 09A8h to 09CFh): the system times of edges at the pins that are not
//! SYNC outputs.

use crate::dc::sync::SyncLine;
use crate::memory::Memory;
use crate::registers::{LATCH_CONTROL, LATCH_STATUS, LATCH_TIMES, PDI_CONFIG, SYNC_UNIT};
use crate::sync_manager::Side;

const TIME_BYTES: u16 = 8;
/// The pin's level in a latch's status, behind the events of the two edges.
const LEVEL: u8 = 1 << 2;
/// In register 0980h: the processor controls LATCH0; LATCH1 is the next bit.
const BY_PROCESSOR: u8 = 1 << 4;

/// Both latches, which have a time for the rising and one for the falling edge.
#[derive(Debug, Clone, Default)]
pub(crate) struct Latches {
    levels: [bool; 2],
    /// Edges whose time was not read yet, as in the status register.
    edges: [u8; 2],
}

impl Latches {
    /// The pin of latch `nth` changes to `level` at system time `time`.
    pub(crate) fn set(&mut self, memory: &mut Memory, nth: usize, level: bool, time: u64) {
        let is_output = memory.byte(PDI_CONFIG + 1) & SyncLine::ALL[nth].is_output() != 0;
        if is_output || self.levels[nth] == level {
            return;
        }
        self.levels[nth] = level;
        let edge = u8::from(!level);
        let single = memory.byte(LATCH_CONTROL + nth as u16) >> edge & 1 != 0;
        if !single || self.edges[nth] >> edge & 1 == 0 {
            self.edges[nth] |= 1 << edge;
            let place = LATCH_TIMES + TIME_BYTES * (2 * nth as u16 + u16::from(edge));
            memory.put(place, &time.to_le_bytes());
        }
    }

    pub(crate) fn show(&self, memory: &mut Memory) {
        for nth in 0..2 {
            let level = if self.levels[nth] { LEVEL } else { 0 };
            memory.set_byte(LATCH_STATUS + nth as u16, self.edges[nth] | level);
        }
    }

    /// `side` has read the first byte of a time at `address`, which clears its event if that side controls the latch.
    pub(crate) fn read(&mut self, memory: &Memory, side: Side, address: u16) {
        let place = address.wrapping_sub(LATCH_TIMES);
        let nth = usize::from(place / (2 * TIME_BYTES));
        if nth < 2 && place.is_multiple_of(TIME_BYTES) && owner(memory, nth) == side {
            self.edges[nth] &= !(1 << (place / TIME_BYTES % 2));
        }
    }

    /// Whether there is an event for `side`.
    pub(crate) fn is_event(&self, memory: &Memory, side: Side) -> bool {
        (0..2).any(|nth| self.edges[nth] != 0 && owner(memory, nth) == side)
    }
}

/// Who controls latch `nth`.
pub(crate) fn owner(memory: &Memory, nth: usize) -> Side {
    if memory.byte(SYNC_UNIT) & BY_PROCESSOR << nth == 0 { Side::Ecat } else { Side::Pdi }
}
