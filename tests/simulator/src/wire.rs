//! An RS-485 bus: whatever one end sends, every other end hears, at the speed of the line.
//!
//! A byte written to a [`LineEnd`] waits in its transmitter, becomes a character with its place in time, and is heard
//! when its last bit has passed. Times are kept in nanoseconds from the start of a run of characters, so that nothing
//! is rounded twice; only the moment of hearing is rounded up to the clock's microsecond. Characters of
//! two ends that overlap corrupt each other, and an end set to another speed or format hears garbage.

use embassy_time::Duration;
use mobgate::hal::Flaws;
use mobgate::settings::{Framing, LineSettings};

use crate::timing::{chars_ns, t1_5_ns, t3_5_ns};

mod bus;
mod character;
mod end;
mod record;
mod relay;

pub use bus::{Heard, LineEnd, Silence, Wire};
pub use character::Flaw;
pub use record::{EndRecord, FRAMES_MAX, WireFrame};

use bus::{End, Run, TICK_NS};

impl Wire {
    /// A bus with nobody on it.
    pub fn new() -> Self {
        Self::default()
    }

    /// Connects one more participant, with `line`'s speed and character format.
    pub fn tap(&self, line: LineSettings) -> LineEnd {
        let mut bus = self.0.borrow_mut();
        let next = bus.first_unheard();
        bus.ends.push(End {
            line,
            echo: false,
            swapped: false,
            flaws: Flaws::default(),
            plugged: true,
            opened: false,
            generation: 0,
            next,
            run: Run::default(),
            waiting: Vec::new(),
            overruns: 0,
            relayed: None,
            relayed_chars: 0,
        });
        bus.record.add_end();
        LineEnd::new(self.clone(), bus.ends.len() - 1, 0)
    }

    /// What participant `end` has done so far.
    pub fn record_of(&self, end: &LineEnd) -> EndRecord {
        self.0.borrow().record.ends[end.number()].clone()
    }

    /// The last frames on the wire, oldest first: at most [`FRAMES_MAX`].
    pub fn frames(&self) -> Vec<WireFrame> {
        self.0.borrow().record.frames.iter().cloned().collect()
    }

    /// The frames of `end`, in `framing`, that stood behind too short a silence: less than the line's gap, t3.5 if it says nothing.
    /// A pause of up to t1.5 inside a frame may be, or of `pause` where that is longer, and the clock knows no time to less than a
    /// tick. `end` cannot heed what it has not heard: what another began to send less than a character, and `reaction`, before, or
    /// in the middle of a frame of `end`.
    pub fn hasty_frames(
        &self,
        (end, framing): (&LineEnd, Framing),
        reaction: Duration,
        pause: Duration,
    ) -> Vec<WireFrame> {
        let (line, number) = (end.line(), end.number());
        let silence_ns = line.gap.map_or(t3_5_ns(&line), |gap| gap.as_nanos());
        let unheard_ns = chars_ns(&line, 1) + reaction.as_nanos() + TICK_NS;
        let frames = self.frames();
        let hasty = |index: &usize| {
            let (before, frame) = (&frames[index - 1], &frames[*index]);
            let own = frames[..*index].iter().rfind(|frame| frame.from == number);
            let gap_ns = frame.gap_ns.unwrap_or(u64::MAX);
            let pause = if before.from == number { pause } else { Duration::from_ticks(0) };
            let pause_ns = t1_5_ns(&line).max(pause.as_nanos()) + TICK_NS;
            let is_pause =
                own.is_some_and(|own| frame.goes_on(own, framing) && frame.start_ns <= own.end_ns + pause_ns);
            let unheard = before.from != number && frame.start_ns <= before.start_ns + unheard_ns;
            frame.from == number && gap_ns + TICK_NS < silence_ns && !is_pause && !unheard
        };
        (1..frames.len()).filter(hasty).map(|index| frames[index].clone()).collect()
    }

    /// How long anybody has been sending, in total.
    pub fn busy(&self) -> Duration {
        Duration::from_nanos(self.0.borrow().record.busy_ns)
    }

    /// Characters that overlapped with those of another end.
    pub fn collisions(&self) -> u64 {
        self.0.borrow().record.collisions
    }
}

#[cfg(test)]
mod tests;
