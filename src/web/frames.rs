//! The captured frames as a file, as they come.

use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{ErrorType, Write};
use heapless::Vec;
use picoserve::io::Write as Stream;
use picoserve::response::chunked::ChunkWriter;

use super::piece::{SHORT_BYTES, Source};
use super::session;
use crate::gateway::web::Token;

/// Bytes of the file that are sent at a time.
const PIECE_BYTES: usize = SHORT_BYTES;
/// Interval of looking for frames.
const FRAMES_PAUSE: Duration = Duration::from_millis(50);
/// Longest time without a byte.
const SIGN_OF_LIFE: Duration = Duration::from_secs(2);

/// Sends the frames from now on, as long as the session lasts.
pub(super) async fn send<W: Stream>(
    source: &Source<'_, '_>,
    token: &Token,
    writer: &mut ChunkWriter<W>,
) -> Result<(), W::Error> {
    let mut out = Buffered { bytes: Vec::new(), writer };
    // A board without is refused before.
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
