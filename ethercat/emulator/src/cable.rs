//! The cable between a MainDevice and a segment: adds delay and faults to frames, and captures them.

use std::cell::{Cell, RefCell};
use std::io::Write;
use std::ops::RangeInclusive;
use std::rc::Rc;

use embassy_time::{Duration, Timer};

use super::pcap::Pcap;
use super::{Fate, Segment, now};
use mobgate_world::random::Random;

/// A segment shared by a test and the cable.
pub type SharedSegment = Rc<RefCell<Segment>>;

/// Probabilities of frame faults.
#[derive(Debug, Clone)]
pub struct FrameFaults {
    /// The frame is lost at a random point.
    pub lost: f64,
    /// The frame is corrupted at a random point, and valid only before it.
    pub corrupt: f64,
    /// The frame passes the segment twice, and both copies return.
    pub doubled: f64,
    /// The frame returns late.
    pub delayed: f64,
    /// The delay in microseconds.
    pub delay_us: RangeInclusive<u64>,
}

impl FrameFaults {
    /// No faults.
    pub const NONE: Self = Self { lost: 0.0, corrupt: 0.0, doubled: 0.0, delayed: 0.0, delay_us: 0..=0 };
}

/// Carries frames to a segment and back.
pub struct Cable {
    segment: SharedSegment,
    frame_time: Duration,
    faults: Rc<RefCell<FrameFaults>>,
    random: Random,
    frames: Rc<Cell<u64>>,
    capture: Option<Pcap<Box<dyn Write>>>,
}

impl Cable {
    /// A cable without faults and with a round trip of `frame_time`.
    pub fn new(segment: SharedSegment, frame_time: Duration) -> Self {
        Self {
            segment,
            frame_time,
            faults: Rc::new(RefCell::new(FrameFaults::NONE)),
            random: Random::new(0),
            frames: Rc::default(),
            capture: None,
        }
    }

    /// The same with faults drawn from `random`.
    #[must_use]
    pub fn with_faults(mut self, faults: FrameFaults, random: Random) -> Self {
        self.faults.replace(faults);
        self.random = random;
        self
    }

    /// The same, capturing all frames in both directions.
    #[must_use]
    pub fn with_capture(mut self, capture: Pcap<Box<dyn Write>>) -> Self {
        self.capture = Some(capture);
        self
    }

    /// The faults, which may be changed while the cable is in use.
    pub fn faults(&self) -> Rc<RefCell<FrameFaults>> {
        self.faults.clone()
    }

    /// The shared counter of frames sent.
    pub fn frames(&self) -> Rc<Cell<u64>> {
        self.frames.clone()
    }

    /// Sends a frame; returns the frames that come back.
    pub async fn carry(&mut self, frame: Vec<u8>) -> Vec<Vec<u8>> {
        self.frames.set(self.frames.get() + 1);
        self.capture(&frame);
        // The frame reaches the middle of the line after half the time.
        Timer::after(self.frame_time / 2).await;
        let faults = self.faults.borrow().clone();
        let times = if self.random.chance(faults.doubled) { 2 } else { 1 };
        let mut back = Vec::new();
        for _ in 0..times {
            let fate = self.fate(&faults);
            let mut frame = frame.clone();
            if self.segment.borrow_mut().pass(now(), &mut frame, fate) {
                back.push(frame);
            }
        }
        Timer::after(self.frame_time - self.frame_time / 2).await;
        if self.random.chance(faults.delayed) {
            Timer::after_micros(self.random.within(faults.delay_us)).await;
        }
        back.iter().for_each(|frame| self.capture(frame));
        back
    }

    fn fate(&mut self, faults: &FrameFaults) -> Fate {
        let places = self.segment.borrow().len() + 1;
        if self.random.chance(faults.lost) {
            Fate::Lost(self.random.index(places))
        } else if self.random.chance(faults.corrupt) {
            Fate::Corrupt(self.random.index(places))
        } else {
            Fate::Intact
        }
    }

    fn capture(&mut self, frame: &[u8]) {
        if let Some(capture) = &mut self.capture {
            capture.frame(now(), frame).expect("room for the capture");
        }
    }
}
