//! Settings in a store: written as the lines that recreate them, read back line by line.

use heapless::String;
use thiserror::Error;

use crate::hal::{Store, StoreError};
use crate::language::{LoadError, Loader, Observer, write_line};
use crate::settings::{LINE_BYTES_MAX, Settings};

/// Bytes read from a store at a time.
const CHUNK_BYTES_MAX: usize = 64;

/// Why saved settings could not be read.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum ReadError {
    /// The store gives nothing.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The store gives a text that is wrong.
    #[error(transparent)]
    Text(#[from] LoadError),
}

/// Reads the text in `store` into `settings`, which are of no use after an error; the number of its bytes, 0 when
/// nothing is saved. `look` sees each line, and the settings behind it.
pub async fn read_store<'s>(
    store: &mut impl Store,
    settings: &'s mut Settings,
    look: &'s mut Observer<'s>,
) -> Result<usize, ReadError> {
    let mut loader = Loader::new(settings).with_observer(look);
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

/// Makes `settings` the text in `store`.
pub async fn write_store(settings: &Settings, store: &mut impl Store) -> Result<(), StoreError> {
    let mut line = String::<{ LINE_BYTES_MAX + 1 }>::new();
    let mut n = 0;
    // With settings that are empty the text is one empty line, so that it is not taken for none.
    loop {
        let more = write_line(settings, n, &mut line).is_some();
        if more || n == 0 {
            // Lines of settings fit, see LINE_BYTES_MAX.
            let _ = line.push('\n');
            store.append(line.as_bytes()).await?;
        }
        if !more {
            return store.commit().await;
        }
        line.clear();
        n += 1;
    }
}
