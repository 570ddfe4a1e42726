//! Responses that take long: the output of `scan` and `tune`, and captured frames as a file.

use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{ErrorType, Write};
use heapless::Vec;
use picoserve::io::Write as Stream;
use picoserve::response::chunked::ChunkWriter;

use super::piece::{SHORT_BYTES, Source};
use super::session;
use crate::console::access::Running;
use crate::gateway::web::Token;

/// Bytes of the file that are sent at a time.
const PIECE_BYTES: usize = SHORT_BYTES;
/// Interval of looking for frames.
const FRAMES_PAUSE: Duration = Duration::from_millis(50);
/// Longest time without a byte.
const SIGN_OF_LIFE: Duration = Duration::from_secs(2);

/// Streams a command's output, including what it has written before, until it or the connection ends.
pub(super) async fn run<W: Stream>(
    source: &Source<'_, '_>,
    running: &mut Running<'_, '_>,
    writer: &mut ChunkWriter<W>,
) -> Result<(), W::Error> {
    loop {
        writer.write_chunk(running.text().as_bytes()).await?;
        writer.flush().await?;
        if !running.next(async || source.gateway.web.stop.wait().await).await {
            return Ok(());
        }
    }
}

/// Sends the frames from now on, as long as the session lasts.
pub(super) async fn frames<W: Stream>(
    source: &Source<'_, '_>,
    token: &Token,
    writer: &mut ChunkWriter<W>,
) -> Result<(), W::Error> {
    let mut out = Buffered { bytes: Vec::new(), writer };
    // `admit` has refused it where there is no capture.
    let Some(mut export) = source.gateway.export(&mut out).await? else { return Ok(()) };
    let mut told = Instant::now();
    loop {
        if !out.bytes.is_empty() {
            out.flush().await?;
            told = Instant::now();
        }
        if !export.write_next(&mut out).await? {
            // Only writing reveals that the client has stopped reading.
            if told.elapsed() >= SIGN_OF_LIFE {
                export.write_lost(&mut out).await?;
            }
            if session::user(source.gateway, token, false).is_none() {
                return Ok(());
            }
            Timer::after(FRAMES_PAUSE).await;
        }
    }
}

/// Gathers bytes into chunks.
struct Buffered<'w, W: Stream> {
    bytes: Vec<u8, PIECE_BYTES>,
    writer: &'w mut ChunkWriter<W>,
}

impl<W: Stream> ErrorType for Buffered<'_, W> {
    type Error = W::Error;
}

impl<W: Stream> Write for Buffered<'_, W> {
    async fn write(&mut self, from: &[u8]) -> Result<usize, W::Error> {
        if self.bytes.is_full() {
            self.flush().await?;
        }
        let room = self.bytes.capacity() - self.bytes.len();
        let now = from.get(..room).unwrap_or(from);
        // It fits.
        let _ = self.bytes.extend_from_slice(now);
        Ok(now.len())
    }

    async fn flush(&mut self) -> Result<(), W::Error> {
        self.writer.write_chunk(&self.bytes).await?;
        self.bytes.clear();
        Ok(())
    }
}
