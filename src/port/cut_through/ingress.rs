//! The receiving end of cut-through.
//!
//! The frame is sent to the router as soon as forwarding may begin, and filled as characters arrive. Inside the gateway it carries
//! a CRC: the received one of an RTU frame, and for ASCII a CRC that is right or wrong as the LRC was. A frame that ends badly or
//! does not fit is marked broken, and so is the forwarded one.

use embassy_time::Instant;

use crate::frame::{Frame, FrameWriter};
use crate::modbus::crc::{crc16, lrc};
use crate::modbus::pdu::End;
use crate::modbus::rtu;
use crate::port::cut_through::timing;
use crate::settings::{Framing, Lane};

/// State of a frame that may be cut through.
pub(crate) enum Passing<'g> {
    /// Not enough has arrived.
    Open,
    /// To be sent to the router at this time, according to what has arrived.
    At(Instant),
    /// It has been sent to the router and is being filled.
    Begun(Ingress<'g>),
    /// It is sent to the router when complete, if at all.
    Whole,
}

impl Passing<'_> {
    /// The state of a frame that began at `begun` on `input`, as far as its end is known.
    pub(crate) fn plan(begun: Instant, input: &Lane, output: &Lane, end: End) -> Self {
        let bytes = match end {
            End::At(length) => Some(1 + length),
            End::Later => None,
            End::Unknown => return Self::Whole,
        };
        timing::start(begun, input, output, bytes).map_or(Self::Open, Self::At)
    }

    /// When to act even if nothing arrives.
    pub(crate) fn due(&self) -> Instant {
        if let Self::At(at) = self { *at } else { Instant::MAX }
    }

    pub(crate) fn is_due(&self) -> bool {
        self.due() <= Instant::now()
    }
}

/// The writing side of a frame that is being forwarded.
pub(crate) struct Ingress<'g> {
    writer: FrameWriter<'g>,
    framing: Framing,
}

impl<'g> Ingress<'g> {
    /// A frame arriving in `framing`.
    pub(crate) fn new(writer: FrameWriter<'g>, framing: Framing) -> Self {
        Self { writer, framing }
    }

    pub(crate) fn frame(&self) -> &Frame<'g> {
        self.writer.frame()
    }

    /// Appends the new part of `received` (unit, PDU, check). Returns false if the frame's length cannot be determined: forwarding
    /// must be given up.
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
                // Deliberately wrong if the LRC is.
                let crc = if lrc(body) == *check { crc16(body) } else { !crc16(body) };
                of_ascii = crc.to_le_bytes();
                &of_ascii
            }
            _ => return true,
        };
        crc.get(passed..).unwrap_or(&[]).iter().for_each(|&byte| self.writer.push_crc(byte));
        true
    }

    /// Completes the valid frame with `pdu`; returns whether it is still wanted.
    pub(crate) fn finish(mut self, pdu: &[u8]) -> bool {
        self.push(pdu);
        self.writer.finish()
    }

    /// Announces the PDU length of an RTU frame. ASCII frames are delimited and never get here.
    fn expect(&mut self, length: usize) {
        if self.framing == Framing::Rtu {
            self.writer.expect(length);
        }
    }

    /// Appends the new part of `pdu`, which never exceeds the frame.
    fn push(&mut self, pdu: &[u8]) {
        let passed = self.frame().pdu(<[u8]>::len);
        if let Some(new) = pdu.get(passed..).filter(|new| !new.is_empty()) {
            let _ = self.writer.push(new);
        }
    }
}

/// Whether an RTU frame with `so_far` after its unit is complete.
pub(crate) fn is_whole(so_far: &[u8], end: End) -> bool {
    matches!(end, End::At(length) if so_far.len() + 1 >= length + rtu::OVERHEAD_BYTES)
}
