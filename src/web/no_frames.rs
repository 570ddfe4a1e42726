//! In place of captured frames, in images without capture: they are refused before.

use picoserve::io::Write;
use picoserve::response::chunked::ChunkWriter;

use super::piece::Source;
use crate::gateway::web::Token;

/// Sends nothing.
pub(super) async fn send<W: Write>(
    _: &Source<'_, '_>,
    _: &Token,
    _: &mut ChunkWriter<W>,
) -> Result<(), W::Error> {
    Ok(())
}
