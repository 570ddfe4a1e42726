//! A new image as a file that is piped in: `ssh anna@gateway update < image.mgu`.

use embassy_time::{Duration, with_timeout};
use embedded_io_async::Read;

use super::Failed;
use super::ymodem::Stopped;
use crate::hal::{Update, UpdateError, Version};

/// Bytes taken from the stream at a time.
const CHUNK_BYTES_MAX: usize = 256;
/// The silence after which the rest will not come.
const SILENCE_MAX: Duration = Duration::from_secs(60);
/// Pieces of a refused file that are dropped, at most: those of the longest image.
const DROPPED_MAX: usize = 1 << 16;

/// Takes all that comes up to the input's end, first what was read `ahead`, into `update`.
pub(in crate::console) async fn piped<IO: Read, U: Update>(
    stream: &mut IO,
    update: &mut U,
    allow_older: bool,
    ahead: &[u8],
) -> Result<Result<Version, Failed>, IO::Error> {
    let mut chunk = [0; CHUNK_BYTES_MAX];
    let mut done = update.begin(None, allow_older).await;
    if done.is_ok() {
        done = update.write(ahead).await;
    }
    let mut stopped = None;
    while done.is_ok() {
        match with_timeout(SILENCE_MAX, stream.read(&mut chunk)).await {
            Ok(Ok(0)) => {
                let finished = update.finish().await;
                update.discard();
                return Ok(finished.map_err(Failed::Refused));
            }
            Ok(read) => done = update.write(chunk.get(..read?).unwrap_or_default()).await,
            Err(_) => {
                stopped = Some(Failed::Stopped(Stopped::Silent));
                break;
            }
        }
    }
    update.discard();
    // The rest of the file is no lines.
    for _ in 0..DROPPED_MAX {
        let read = with_timeout(SILENCE_MAX, stream.read(&mut chunk)).await;
        if read.unwrap_or(Ok(0))? == 0 {
            break;
        }
    }
    Ok(Err(stopped.unwrap_or(Failed::Refused(done.err().unwrap_or(UpdateError::Failed)))))
}
