//! Work that takes time: what is done before a response, and the output of `scan` and `tune`, which is streamed.

use core::future::pending;

use picoserve::io::Write as Stream;
use picoserve::response::chunked::ChunkWriter;

use super::commands::failed;
use super::piece::Source;
use super::response::{Content, Response};
use crate::console::access::Running;
use crate::gateway::direct_request::DirectRequestError;

impl Response<'_, '_> {
    /// Does what must be over before the status can be told. It is done in place, so that there is one response in memory.
    pub(super) async fn settle(&mut self) {
        match &mut self.content {
            Content::Values(asked, _) => match asked.ask().await {
                Ok(()) => {}
                Err(DirectRequestError::Broadcast) => *self = Self::json(200, format_args!("{{\"unit\":0}}")),
                Err(error) => *self = Self::error(409, &error),
            },
            Content::Point(running) => {
                while running.next(pending).await {
                    if running.has_failed() {
                        *self = failed(running);
                        return;
                    }
                }
                *self = Self::done();
            }
            _ => {}
        }
    }
}

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
