//! Settings in a store: written as the lines that recreate them, read back line by line.

use core::fmt::Write;

use thiserror::Error;

use crate::hal::{Store, StoreError};
use crate::language::{LineBuffer, LoadError, Loader, Observer, write_line};
use crate::settings::Settings;

/// Bytes read from a store at a time.
const CHUNK_BYTES_MAX: usize = 64;

/// Why saved settings could not be read.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum ReadError {
    /// The store cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The text in the store is invalid.
    #[error(transparent)]
    Text(#[from] LoadError),
}

/// Reads the text in `store` into `settings`, which are invalid after an error, line by line in the memory of `line`; returns its length,
/// 0 if nothing is saved. Calls `look` after each line.
pub async fn read_store<'s>(
    store: &mut impl Store,
    settings: &'s mut Settings,
    line: &'s mut LineBuffer,
    look: &'s mut Observer<'s>,
) -> Result<usize, ReadError> {
    let mut loader = Loader::new(settings, line).with_observer(look);
    let mut chunk = [0; CHUNK_BYTES_MAX];
    let mut offset = 0;
    loop {
        let count = store.read(offset, &mut chunk).await?;
        if count == 0 {
            break;
        }
        loader.feed(chunk.get(..count).unwrap_or_default())?;
        offset += count;
    }
    loader.finish()?;
    Ok(offset)
}

/// Writes `settings` to `store`, line by line in the memory of `line`.
pub async fn write_store(
    settings: &Settings,
    store: &mut impl Store,
    line: &mut LineBuffer,
) -> Result<(), StoreError> {
    let mut n = 0;
    // Empty settings are stored as one empty line, to distinguish them from missing settings.
    loop {
        line.clear();
        // It fits with its end, see LINE_BYTES_MAX.
        let more = write_line(settings, n, line).is_some();
        if more || n == 0 {
            let _ = line.write_str("\n");
            store.append(line.bytes()).await?;
        }
        if !more {
            return store.commit().await;
        }
        n += 1;
    }
}
