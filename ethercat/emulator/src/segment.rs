//! A line of chips, which a frame passes in order and returns from the last; or a ring that may be cut.

use std::cell::RefCell;
use std::rc::Rc;

use super::frame::is_ethercat;
use super::{Chip, Nanos, SharedChip};

/// Delay from one chip to the next: cable and forwarding.
const HOP_NANOS: Nanos = 500;

/// The fate of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    /// It returns.
    Intact,
    /// Lost before this device; one past the last means on the way back.
    Lost(usize),
    /// A bit flips before this device; one past the last means on the way back. Devices after it reject the frame.
    Corrupt(usize),
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

    /// Chip number `nth`.
    ///
    /// # Panics
    /// If there are fewer chips.
    pub fn chip(&self, nth: usize) -> SharedChip {
        self.chips[nth].clone()
    }

    /// Number of chips.
    #[expect(clippy::len_without_is_empty, reason = "a line without devices is no line")]
    pub fn len(&self) -> usize {
        self.chips.len()
    }

    /// Closes the line to a ring: the last chip's second port leads to the MainDevice's second port.
    pub fn close_ring(&mut self) {
        self.link(true);
    }

    /// Cuts the cable before device number `nth` of a ring.
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

    /// Sends `frame` into the line from its first end, modifying it; returns whether it comes back intact.
    pub fn pass(&mut self, at: Nanos, frame: &mut [u8], fate: Fate) -> bool {
        let reached = self.cut.unwrap_or(self.chips.len());
        self.through(at, frame, fate, 0..reached)
    }

    /// Sends `frame` into a ring from its second end. It is processed only behind a cut: by the chips in line order, since each
    /// processes frames from its first port. Otherwise it leaves unmodified at the first end.
    pub fn pass_back(&mut self, at: Nanos, frame: &mut [u8], fate: Fate) -> bool {
        match self.cut {
            Some(cut) => self.through(at, frame, fate, cut..self.chips.len()),
            None => fate == Fate::Intact,
        }
    }

    fn through(&mut self, at: Nanos, frame: &mut [u8], fate: Fate, range: std::ops::Range<usize>) -> bool {
        // Before a cut there may be no chip to check.
        if !is_ethercat(frame) {
            return false;
        }
        let last = range.end;
        for nth in range {
            if fate == Fate::Lost(nth) {
                return false;
            }
            let good = !matches!(fate, Fate::Corrupt(before) if before <= nth);
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
