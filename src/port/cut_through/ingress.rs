//! A frame that is passed on while it arrives, seen from where it arrives.
//!
//! It is handed on as soon as its copy may begin, and filled as its characters come. In the gateway it is under the CRC: that of
//! an RTU frame as it came, and for an ASCII one the CRC that says of it what its LRC said. A frame that does not end well, or
//! that does not fit, is broken, and its copy with it.

use embassy_time::Instant;

use crate::frame::{Frame, FrameWriter};
use crate::modbus::crc::{crc16, lrc};
use crate::modbus::pdu::End;
use crate::modbus::rtu;
use crate::port::cut_through::timing;
use crate::settings::{Framing, Lane};

/// How far a frame is that may be passed on.
pub(crate) enum Passing<'g> {
    /// Too little of it is there.
    Open,
    /// It is to be handed on at this time, as far as what is there tells.
    At(Instant),
    /// It has been handed on.
    Begun(Ingress<'g>),
    /// It is passed on when it is whole, if at all.
    Whole,
}

impl Passing<'_> {
    /// What becomes of a frame that began at `begun` on `input`, as far as its end is known.
    pub(crate) fn plan(begun: Instant, input: &Lane, output: &Lane, end: End) -> Self {
        let bytes = match end {
            End::At(length) => Some(1 + length),
            End::Later => None,
            End::Unknown => return Self::Whole,
        };
        timing::start(begun, input, output, bytes).map_or(Self::Open, Self::At)
    }

    /// When there is something to do though nothing comes.
    pub(crate) fn due(&self) -> Instant {
        if let Self::At(at) = self { *at } else { Instant::MAX }
    }

    pub(crate) fn is_due(&self) -> bool {
        self.due() <= Instant::now()
    }
}

/// The filling side of a frame that was handed on.
pub(crate) struct Ingress<'g> {
    writer: FrameWriter<'g>,
    framing: Framing,
}

impl<'g> Ingress<'g> {
    /// A frame that arrives in `framing`.
    pub(crate) fn new(writer: FrameWriter<'g>, framing: Framing) -> Self {
        Self { writer, framing }
    }

    /// The frame.
    pub(crate) fn frame(&self) -> &Frame<'g> {
        self.writer.frame()
    }

    /// Passes on what is new in `heard`: the unit and what has come behind it, its check included. False when the frame has no
    /// end that could be told: it must be given up.
    pub(crate) fn take(&mut self, received: &[u8], end: End) -> bool {
        let so_far = received.get(1..).unwrap_or(&[]);
        let length = match end {
            End::At(length) => {
                self.expect(length);
                length
            }
            End::Later => so_far.len(),
            End::Unknown => return false,
        };
        let (pdu, check) = so_far.split_at_checked(length).unwrap_or((so_far, &[]));
        self.push(pdu);
        let ((_, passed), body) = (self.frame().crc(), received.get(..=length));
        let of_ascii;
        let crc = match (self.framing, check, body) {
            (Framing::Rtu, _, _) => check.get(..size_of::<u16>()).unwrap_or(check),
            (Framing::Ascii, [check, ..], Some(body)) => {
                // Certainly a wrong one where the LRC is.
                let crc = if lrc(body) == *check { crc16(body) } else { !crc16(body) };
                of_ascii = crc.to_le_bytes();
                &of_ascii
            }
            _ => return true,
        };
        crc.get(passed..).unwrap_or(&[]).iter().for_each(|&byte| self.writer.push_crc(byte));
        true
    }

    /// The frame is whole and good, with `pdu`. Says whether it is still wanted.
    pub(crate) fn finish(mut self, pdu: &[u8]) -> bool {
        self.push(pdu);
        self.writer.finish()
    }

    /// The PDU of an RTU frame will have `length` bytes. It does not come to that in ASCII, where frames have their ends in them.
    fn expect(&mut self, length: usize) {
        if self.framing == Framing::Rtu {
            self.writer.expect(length);
        }
    }

    /// Passes on what is new in `pdu`, which is no longer than a PDU may be, so that there is room.
    fn push(&mut self, pdu: &[u8]) {
        let passed = self.frame().pdu(<[u8]>::len);
        if let Some(new) = pdu.get(passed..).filter(|new| !new.is_empty()) {
            let _ = self.writer.push(new);
        }
    }
}

/// Whether all characters of an RTU frame are there that has `so_far` behind its unit.
pub(crate) fn is_whole(so_far: &[u8], end: End) -> bool {
    matches!(end, End::At(length) if so_far.len() + 1 >= length + rtu::OVERHEAD_BYTES)
}
