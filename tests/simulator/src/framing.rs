//! How a participant of a line hears whole frames, in RTU by silences and in ASCII by their first and last characters.

use mobgate::settings::Framing;

use crate::device::{ascii, rtu};
use crate::wire::{Heard, LineEnd, Silence};

/// A longer silence inside an ASCII frame spoils it, Modbus over Serial Line 2.5.2.1.
const ASCII_SILENCE_NS: u64 = 1_000_000_000;
/// Any silence at all: what comes together is heard together.
const NO_SILENCE: Silence = Silence { inside_ns: u64::MAX, between_ns: 1 };

/// The frame of `pdu` from or to `unit`.
pub fn frame(framing: Framing, unit: u8, pdu: &[u8]) -> Vec<u8> {
    match framing {
        Framing::Rtu => rtu::frame(unit, pdu),
        Framing::Ascii => ascii::frame(unit, pdu),
    }
}

/// Unit and PDU of `frame`, when it is intact.
pub fn open(framing: Framing, frame: &[u8]) -> Option<(u8, Vec<u8>)> {
    match framing {
        Framing::Rtu => rtu::open(frame).map(|(unit, pdu)| (unit, pdu.to_vec())),
        Framing::Ascii => ascii::open(frame),
    }
}

/// Hears the frames on a line.
pub struct Listener {
    line: LineEnd,
    framing: Framing,
    /// ASCII characters of a frame whose end has not come, or of more than one frame.
    characters: Vec<u8>,
    heard_ns: u64,
}

impl Listener {
    /// Listens at `line`.
    pub fn new(line: LineEnd, framing: Framing) -> Self {
        Self { line, framing, characters: Vec::new(), heard_ns: 0 }
    }

    /// The next frame, good or not. Dropping the pending future loses nothing.
    pub async fn hear(&mut self) -> Heard {
        if self.framing == Framing::Rtu {
            return self.line.frame(Silence::of(&self.line.line())).await;
        }
        loop {
            if let Some(bytes) = self.take_characters() {
                return Heard { bytes, gap_inside: false, end_ns: self.heard_ns };
            }
            let heard = self.line.frame(NO_SILENCE).await;
            if heard.end_ns.saturating_sub(self.heard_ns) > ASCII_SILENCE_NS {
                self.characters.clear();
            }
            self.characters.extend(heard.bytes);
            self.heard_ns = heard.end_ns;
        }
    }

    /// Takes the first frame out: from the last colon before a line feed, or from wherever there is none.
    fn take_characters(&mut self) -> Option<Vec<u8>> {
        let end = self.characters.iter().position(|&character| character == b'\n')?;
        let mut frame: Vec<u8> = self.characters.drain(..=end).collect();
        let start = frame.iter().rposition(|&character| character == b':').unwrap_or(0);
        Some(frame.split_off(start))
    }
}
