//! A new image as a file that is piped in: `ssh anna@gateway update < image.mgu`.

use embassy_time::{Duration, with_timeout};
use embedded_io_async::Read;

use crate::hal::{Update, UpdateError, Version};

/// Bytes taken from the stream at a time.
const CHUNK_BYTES_MAX: usize = 256;
/// The silence after which the rest will not come.
const SILENCE_MAX: Duration = Duration::from_secs(60);
/// Pieces of a refused file that are dropped, at most: those of the longest image.
const DROPPED_MAX: usize = 1 << 16;

/// Writes the input up to its end into `update`, beginning with what was read `ahead`. Returns why it failed; nothing if the input stops
/// short.
pub(super) async fn receive<IO: Read, U: Update>(
    stream: &mut IO,
    update: &mut U,
    allow_older: bool,
    ahead: &[u8],
) -> Result<Result<Version, Option<UpdateError>>, IO::Error> {
    let mut chunk = [0; CHUNK_BYTES_MAX];
    let mut done = update.begin(None, allow_older).await;
    if done.is_ok() {
        done = update.write(ahead).await;
    }
    let mut comes = true;
    while comes && done.is_ok() {
        match with_timeout(SILENCE_MAX, stream.read(&mut chunk)).await {
            Ok(Ok(0)) => {
                let finished = update.finish().await;
                update.discard();
                return Ok(finished.map_err(Some));
            }
            Ok(read) => done = update.write(chunk.get(..read?).unwrap_or_default()).await,
            Err(_) => comes = false,
        }
    }
    update.discard();
    // The rest of the file must not be run as lines.
    for _ in 0..DROPPED_MAX {
        let read = with_timeout(SILENCE_MAX, stream.read(&mut chunk)).await;
        if read.unwrap_or(Ok(0))? == 0 {
            break;
        }
    }
    Ok(Err(done.err()))
}
