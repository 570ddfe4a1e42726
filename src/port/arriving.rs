//! A frame that is passed on while it arrives, seen from where it arrives.
//!
//! It is handed on as soon as its copy may begin, and filled as its characters come. Its last one is held back until
//! everything before it has been checked; a frame that does not fit is broken instead, and its copy with it.

use embassy_time::Instant;

use crate::config::LineSettings;
use crate::frame::{Frame, FrameWriter};
use crate::modbus::pdu::End;
use crate::modbus::rtu;
use crate::port::cut;

/// How far a frame is that may be passed on.
pub(crate) enum Passing<'g> {
    /// Too little of it is there.
    Open,
    /// It is to be handed on at this time.
    From(Instant),
    /// It has been handed on.
    Begun(Arriving<'g>),
    /// It is passed on when it is whole, if at all.
    Whole,
}

impl Passing<'_> {
    /// What becomes of a frame that began at `begun` on `input`, as far as its end is known.
    pub(crate) fn plan(begun: Instant, input: &LineSettings, output: &LineSettings, end: End) -> Self {
        let characters = match end {
            End::At(length) => Some(length + rtu::OVERHEAD_BYTES),
            End::Later => None,
            End::Unknown => return Self::Whole,
        };
        cut::start(begun, input, output, characters).map_or(Self::Open, Self::From)
    }

    /// When there is something to do though nothing comes.
    pub(crate) fn due(&self) -> Instant {
        if let Self::From(at) = self { *at } else { Instant::MAX }
    }

    pub(crate) fn is_due(&self) -> bool {
        self.due() <= Instant::now()
    }
}

/// The filling side of a frame that was handed on.
pub(crate) struct Arriving<'g> {
    writer: FrameWriter<'g>,
    /// Characters behind the unit that were passed on.
    passed: usize,
}

impl<'g> Arriving<'g> {
    pub(crate) fn new(writer: FrameWriter<'g>) -> Self {
        Self { writer, passed: 0 }
    }

    /// The frame.
    pub(crate) fn frame(&self) -> &Frame<'g> {
        self.writer.frame()
    }

    /// Passes on what stands behind the unit so far, except for the last character. False when the frame has no end that
    /// could be told: it must be given up.
    pub(crate) fn take(&mut self, so_far: &[u8], end: End) -> bool {
        match end {
            End::At(length) => self.pass(so_far.get(..length + 1).unwrap_or(so_far), length),
            End::Later => self.pass(so_far, so_far.len()),
            End::Unknown => return false,
        }
        true
    }

    /// The frame is whole and good. Says whether it is still wanted.
    pub(crate) fn finish(self) -> bool {
        self.writer.finish()
    }

    /// The frame is whole and not good. If it was damaged on its way it is passed on as it is, so that the far end sees
    /// that; if it has no business there, its last character is never sent.
    pub(crate) fn fail(mut self, heard: &[u8], end: End) {
        if let (Err(_), Some((_, so_far)), End::At(length)) = (rtu::decode(heard), heard.split_first(), end) {
            self.pass(so_far.get(..length + 2).unwrap_or(so_far), length);
        }
    }

    /// Passes on what is new in `so_far`, of which the first `length` bytes are the PDU's.
    fn pass(&mut self, so_far: &[u8], length: usize) {
        let (pdu, crc) = so_far.split_at_checked(length).unwrap_or((so_far, &[]));
        // The end is no further than a PDU's, so there is room.
        let _ = self.writer.push(pdu.get(self.passed..).unwrap_or(&[]));
        let crc_passed = self.passed.saturating_sub(length);
        crc.get(crc_passed..).unwrap_or(&[]).iter().for_each(|&byte| self.writer.push_crc(byte));
        self.passed = self.passed.max(so_far.len());
    }
}

/// Whether all characters of a frame are there that has `so_far` behind its unit.
pub(crate) fn is_whole(so_far: &[u8], end: End) -> bool {
    matches!(end, End::At(length) if so_far.len() + 1 >= length + rtu::OVERHEAD_BYTES)
}
