//! Fills a frame, possibly while others already read it.

use super::{Fill, Frame, FrameFull, FramePool};
use crate::modbus::PDU_BYTES_MAX;

/// Fills a frame; marks it broken if dropped before [`FrameWriter::finish`].
pub struct FrameWriter<'p> {
    frame: Frame<'p>,
}

impl<'p> FrameWriter<'p> {
    /// The frame that is being filled.
    pub fn frame(&self) -> &Frame<'p> {
        &self.frame
    }

    /// Appends `bytes`, all or none of them, and wakes the reader.
    pub fn push(&mut self, bytes: &[u8]) -> Result<(), FrameFull> {
        let appended = self.frame.with(|slot| {
            let length = usize::from(slot.length);
            slot.pdu.get_mut(length..length + bytes.len())?.copy_from_slice(bytes);
            slot.length += bytes.len() as u8;
            slot.waiting.wake();
            Some(())
        });
        appended.flatten().ok_or(FrameFull)
    }

    /// Announces that the PDU will have `length` bytes.
    pub fn expect(&mut self, length: usize) {
        self.frame.with(|slot| slot.expected = length.min(PDU_BYTES_MAX) as u8);
    }

    /// Appends a byte of the CRC, which has not been checked yet.
    pub fn push_crc(&mut self, byte: u8) {
        self.frame.with(|slot| {
            if let Some(place) = slot.crc.get_mut(usize::from(slot.crc_bytes)) {
                *place = byte;
                slot.crc_bytes += 1;
                slot.waiting.wake();
            }
        });
    }

    /// Marks the frame complete and valid; returns whether it is still wanted, and was not [abandoned](Frame::abandon).
    pub fn finish(self) -> bool {
        let finished = self.frame.with(|slot| {
            let wanted = slot.fill == Fill::Filling;
            if wanted {
                slot.fill = Fill::Complete;
                slot.waiting.wake();
            }
            wanted
        });
        finished == Some(true)
    }
}

impl Drop for FrameWriter<'_> {
    fn drop(&mut self) {
        self.frame.abandon();
    }
}

impl<'p> FramePool<'p> {
    /// A frame for `owner`: its reserved one if that is free, otherwise a shared one, otherwise `None`.
    pub fn take(&'p self, owner: usize) -> Option<(FrameWriter<'p>, Frame<'p>)> {
        let frame = self.claim(owner, None)?;
        Some((FrameWriter { frame: frame.share() }, frame))
    }
}

impl<'p> Frame<'p> {
    /// Empties the frame and returns a writer for its new content (a response replacing the request).
    pub fn rewrite(&self) -> FrameWriter<'p> {
        self.with(|slot| {
            slot.restart();
        });
        FrameWriter { frame: self.share() }
    }
}
