//! Work that takes a while, whose text is sent as it comes: `scan` and `tune`, and the frames of the lines as a file.

use core::convert::Infallible;

use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{ErrorType, Write};
use heapless::Vec;
use picoserve::io::Write as Stream;
use picoserve::response::chunked::ChunkWriter;

use super::piece::Source;
use super::session;
use crate::capture::Export;
use crate::console::access::Running;
use crate::gateway::web::Token;

/// Fits a frame with what precedes and follows it in the file, and the beginning of the file.
const FRAME_BYTES_MAX: usize = 2_048;
/// Interval of looking for frames.
const FRAMES_PAUSE: Duration = Duration::from_millis(50);
/// Longest time without a byte.
const SIGN_OF_LIFE: Duration = Duration::from_secs(2);

/// Sends what a command writes, from what it has written before on, until it ends or the connection does.
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
    let mut buffer = Buffer(Vec::new());
    // `admit` has refused it where there is no capture.
    let Ok(Some(mut export)) = Export::begin(source.gateway, &mut buffer).await else { return Ok(()) };
    let mut told = Instant::now();
    loop {
        if !buffer.0.is_empty() {
            writer.write_chunk(&buffer.0).await?;
            buffer.0.clear();
            told = Instant::now();
        }
        let Ok(is_one) = export.write_next(&mut buffer).await;
        if !is_one {
            // Only what is written shows that nobody reads any more.
            if told.elapsed() >= SIGN_OF_LIFE {
                let Ok(()) = export.write_lost(&mut buffer).await;
            }
            if session::user(source.gateway, token, false).is_none() {
                return Ok(());
            }
            Timer::after(FRAMES_PAUSE).await;
        }
    }
}

/// Bytes that are sent at once.
struct Buffer(Vec<u8, FRAME_BYTES_MAX>);

impl ErrorType for Buffer {
    type Error = Infallible;
}

impl Write for Buffer {
    async fn write(&mut self, from: &[u8]) -> Result<usize, Infallible> {
        // Sized for what is written.
        let _ = self.0.extend_from_slice(from);
        Ok(from.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}
