//! A line of chips: a frame passes one after the other and comes back from the last; or a ring that may be cut.

use std::cell::RefCell;
use std::rc::Rc;

use super::frame::is_ethercat;
use super::{Chip, Nanos, SharedChip};

/// From one chip to the next: cable and forwarding.
const HOP_NANOS: Nanos = 500;

/// What happens to a frame on its way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    /// It comes back.
    Intact,
    /// It vanishes before this device; behind the last, on the way back.
    Lost(usize),
    /// A bit falls over before this device; behind the last, on the way back. Those behind do not believe what it says.
    Damaged(usize),
}

/// Chips in a line, the first nearest to the MainDevice.
pub struct Segment {
    chips: Vec<SharedChip>,
    /// The cable before this device is cut.
    cut: Option<usize>,
}

impl Segment {
    /// A line of these chips.
    pub fn new(chips: impl IntoIterator<Item = Chip>) -> Self {
        let chips = chips.into_iter().map(|chip| Rc::new(RefCell::new(chip))).collect();
        let segment = Self { chips, cut: None };
        segment.link(false);
        segment
    }

    /// The chip in place `nth`.
    ///
    /// # Panics
    /// When there are not so many.
    pub fn chip(&self, nth: usize) -> SharedChip {
        self.chips[nth].clone()
    }

    /// How many chips there are.
    #[expect(clippy::len_without_is_empty, reason = "a line without devices is no line")]
    pub fn len(&self) -> usize {
        self.chips.len()
    }

    /// Closes the line to a ring: the last chip's second port leads to the MainDevice's second port.
    pub fn close_ring(&mut self) {
        self.link(true);
    }

    /// Cuts the cable before the device in place `nth` of a ring.
    pub fn cut(&mut self, nth: usize) {
        self.cut = Some(nth);
        for (at, chip) in self.chips.iter().enumerate() {
            let chip = &mut chip.borrow_mut();
            if at == nth {
                chip.set_port(0, false);
            } else if at + 1 == nth {
                chip.set_port(1, false);
            }
        }
    }

    fn link(&self, ring: bool) {
        for (nth, chip) in self.chips.iter().enumerate() {
            chip.borrow_mut().set_port(1, ring || nth + 1 < self.chips.len());
        }
    }

    /// Sends `frame` through the line from its first end, changing it on its way; whether it comes back to be believed.
    pub fn pass(&mut self, at: Nanos, frame: &mut [u8], fate: Fate) -> bool {
        let reached = self.cut.unwrap_or(self.chips.len());
        self.through(at, frame, fate, 0..reached)
    }

    /// Sends `frame` into a ring from its second end. Only behind a cut it is processed: by the chips in the order of the
    /// line, since each processes what comes from its first port. Else it comes out at the first end as it was.
    pub fn pass_back(&mut self, at: Nanos, frame: &mut [u8], fate: Fate) -> bool {
        match self.cut {
            Some(cut) => self.through(at, frame, fate, cut..self.chips.len()),
            None => fate == Fate::Intact,
        }
    }

    fn through(&mut self, at: Nanos, frame: &mut [u8], fate: Fate, range: std::ops::Range<usize>) -> bool {
        // Before a cut there may be no chip to look.
        if !is_ethercat(frame) {
            return false;
        }
        let last = range.end;
        for nth in range {
            if fate == Fate::Lost(nth) {
                return false;
            }
            let good = !matches!(fate, Fate::Damaged(before) if before <= nth);
            let arrival = at + nth as Nanos * HOP_NANOS;
            let hops_behind = (last - 1 - nth) as Nanos * 2;
            let returned = (last - 1 > nth).then_some(arrival + hops_behind * HOP_NANOS);
            if !self.chips[nth].borrow_mut().pass_on(arrival, frame, returned, good) {
                return false;
            }
        }
        fate == Fate::Intact
    }
}
