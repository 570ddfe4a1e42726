//! Responses that take long: the output of `scan` and `tune`.

use picoserve::io::Write;
use picoserve::response::chunked::ChunkWriter;

use super::piece::Source;
use crate::console::access::Running;

/// Streams a command's output, including what it has written before, until it or the connection ends.
pub(super) async fn run<W: Write>(
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
