//! What has happened on a wire: frames with their places in time, and sums that stay small in a long run.

use std::collections::VecDeque;

use mobgate::settings::Framing;

use super::character::Character;

/// Frames that the record keeps, the newest; sums go on for ever.
pub const FRAMES_MAX: usize = 10_000;

/// One participant's part in the traffic.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct EndRecord {
    /// Characters sent.
    pub characters: u64,
    /// Frames sent: characters after another's, or after a silence of more than 1.5 characters.
    pub frames: u64,
    /// The shortest silence on the wire before one of the frames; none before the wire's first.
    pub shortest_gap_ns: Option<u64>,
    /// Reads that gave something: as often was it woken by what came.
    pub reads: u64,
    /// When the transceiver's driver was switched on and off.
    pub switched: Vec<(u64, bool)>,
}

/// Characters of one end without a silence of more than 1.5 characters.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WireFrame {
    /// The sender, as [`LineEnd::number`](super::LineEnd::number) says.
    pub from: usize,
    /// The first start bit's beginning.
    pub start_ns: u64,
    /// The last stop bit's end.
    pub end_ns: u64,
    /// The silence before it; none before the wire's first frame, zero when another was still sending.
    pub gap_ns: Option<u64>,
    /// What was sent, without regard to corruption on the way.
    pub bytes: Vec<u8>,
}

impl WireFrame {
    /// Whether it may be the rest of `before`, which paused: an ASCII frame shows where it begins and ends.
    pub(super) fn goes_on(&self, before: &Self, framing: Framing) -> bool {
        let is_apart = self.bytes.first() == Some(&b':') || before.bytes.last() == Some(&b'\n');
        before.from == self.from && (framing == Framing::Rtu || !is_apart)
    }
}

#[derive(Default)]
pub(super) struct Record {
    pub(super) ends: Vec<EndRecord>,
    pub(super) frames: VecDeque<WireFrame>,
    pub(super) busy_ns: u64,
    pub(super) collisions: u64,
    /// The end of the last activity of anybody.
    quiet_from_ns: Option<u64>,
    last_from: Option<usize>,
}

impl Record {
    pub(super) fn add_end(&mut self) {
        self.ends.push(EndRecord::default());
    }

    pub(super) fn add(&mut self, character: &Character, char_ns: u64) {
        let gap_ns = self.quiet_from_ns.map(|quiet| character.start_ns.saturating_sub(quiet));
        let same_sender = self.last_from == Some(character.from);
        let first = !same_sender || gap_ns.is_none_or(|gap| 2 * gap > 3 * char_ns);
        let end = &mut self.ends[character.from];
        end.characters += 1;
        if first {
            end.frames += 1;
            end.shortest_gap_ns = end.shortest_gap_ns.into_iter().chain(gap_ns).min();
            if self.frames.len() == FRAMES_MAX {
                self.frames.pop_front();
            }
            self.frames.push_back(WireFrame {
                from: character.from,
                start_ns: character.start_ns,
                end_ns: character.end_ns,
                gap_ns,
                bytes: Vec::new(),
            });
        }
        if let Some(frame) = self.frames.back_mut() {
            frame.end_ns = character.end_ns;
            frame.bytes.push(character.byte);
        }
        let quiet = self.quiet_from_ns.unwrap_or(0);
        self.busy_ns += character.end_ns.saturating_sub(character.start_ns.max(quiet));
        self.quiet_from_ns = Some(quiet.max(character.end_ns));
        self.last_from = Some(character.from);
    }
}
