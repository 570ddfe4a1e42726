//! Exports the capture as a growing PCAPNG file, to a file or a TCP client.

use embedded_io_async::Write;

use super::{Capture, Following, pcapng};
use crate::settings::Name;

/// Exports the frames from now on. It never blocks others: frames overwritten before it has read them are lost, and their number is
/// written to the file.
pub struct Export<'c> {
    capture: &'c Capture,
    following: Following<'c>,
    dropped: u64,
}

impl<'c> Export<'c> {
    /// Writes the start of the file: the section, and each port as an interface.
    pub(crate) async fn begin<W: Write>(
        capture: &'c Capture,
        mut names: impl Iterator<Item = Name>,
        out: &mut W,
    ) -> Result<Self, W::Error> {
        let export = Self { capture, following: capture.follow(), dropped: 0 };
        out.write_all(&pcapng::header()).await?;
        // The name is not held while the block is written.
        while let Some(block) = names.next().map(|name| pcapng::interface(&name)) {
            out.write_all(&block).await?;
        }
        Ok(export)
    }

    /// Writes how many frames were lost so far: a sign of life while none come.
    // Only the web interface needs it: elsewhere the other end is read.
    #[cfg(all(feature = "web", feature = "capture"))]
    pub(crate) async fn write_lost<W: Write>(&self, out: &mut W) -> Result<(), W::Error> {
        let epoch_us = self.capture.epoch_us.lock(core::cell::Cell::get);
        out.write_all(&pcapng::statistics(embassy_time::Instant::now(), epoch_us, self.dropped)).await
    }

    /// Writes the frames that are in the ring now, and ends behind them.
    #[cfg(feature = "files")] // As what uses it.
    pub(crate) async fn write_kept<W: Write>(&mut self, out: &mut W) -> Result<(), W::Error> {
        let end = self.capture.end();
        self.following.cursor = self.capture.first();
        // Frames that were overwritten meanwhile are skipped, also beyond that end.
        while (end.wrapping_sub(self.following.cursor) as i32) > 0 && self.write_next(out).await? {}
        Ok(())
    }

    /// Writes the next frame, if there is one; returns whether there was.
    pub async fn write_next<W: Write>(&mut self, out: &mut W) -> Result<bool, W::Error> {
        let Some(mut frame) = self.following.next() else { return Ok(false) };
        // Blocks are encoded one by one, so that the future holds one at most: each connection of a board has such a future.
        let epoch_us = || self.capture.epoch_us.lock(core::cell::Cell::get);
        if frame.missed > 0 {
            self.dropped += u64::from(frame.missed);
            out.write_all(&pcapng::statistics(frame.head.at, epoch_us(), self.dropped)).await?;
        }
        out.write_all(&pcapng::before(&frame, epoch_us())).await?;
        loop {
            out.write_all(&frame.bytes).await?;
            if !self.capture.next_part(&mut frame) {
                break;
            }
        }
        out.write_all(&pcapng::behind(&frame)).await?;
        Ok(true)
    }
}
