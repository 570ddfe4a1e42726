//! Cuts a frame of the application into fragments.

use super::header::{HEADER_BYTES, Header, UNIT_BYTES};
use super::link::{FRAME_BYTES_MAX, Link};
use crate::mailbox::Payload;

/// A frame that is sent.
#[derive(Debug)]
pub(super) struct Outgoing {
    buffer: [u8; FRAME_BYTES_MAX],
    /// 0: there is none.
    length: usize,
    sent: usize,
    /// The number of the next fragment.
    number: u8,
    /// The number of the frame.
    frame: u8,
}

impl Outgoing {
    pub(super) const fn new() -> Self {
        Self { buffer: [0; FRAME_BYTES_MAX], length: 0, sent: 0, number: 0, frame: 0 }
    }

    /// Takes the next frame if none is being sent; returns whether there is one.
    pub(super) fn load(&mut self, link: &mut impl Link) -> bool {
        if self.length == 0 {
            self.length = link.transmit(&mut self.buffer).unwrap_or(0).min(FRAME_BYTES_MAX);
            (self.sent, self.number) = (0, 0);
            self.frame = (self.frame + u8::from(self.length > 0)) % 16;
        }
        self.length > 0
    }

    /// The frame's next fragment, for a mailbox with `room` bytes. `None` if it carries no fragment: the frame is dropped.
    pub(super) fn next(&mut self, room: usize, port: u8) -> Option<Payload> {
        let room = room.saturating_sub(HEADER_BYTES);
        let rest = self.buffer.get(self.sent..self.length)?;
        let last = rest.len() <= room;
        let bytes = match last {
            true => rest,
            false => rest.get(..room / UNIT_BYTES * UNIT_BYTES)?,
        };
        if bytes.is_empty() {
            self.length = 0;
            return None;
        }
        let offset = match self.number {
            0 => self.length.div_ceil(UNIT_BYTES),
            _ => self.sent / UNIT_BYTES,
        };
        let message = Header::fragment(port, last, self.number, offset, self.frame).message(bytes);
        self.sent += bytes.len();
        self.number += 1;
        if last {
            self.length = 0;
        }
        Some(message)
    }

    pub(super) fn drop_partial(&mut self) {
        self.length = 0;
    }
}
