//! A file, pipe or terminal written by a thread, so that slow ones do not block the ports.

use std::io;
use std::sync::Arc;

use embedded_io_async::{ErrorType, Write};

use crate::worker::Worker;

/// Bytes buffered before an automatic flush.
const GATHERED_MAX: usize = 64 * 1024;

/// The file, its thread, and the bytes to be written.
#[derive(Debug)]
pub(crate) struct Sink<W> {
    file: Arc<W>,
    worker: Worker,
    gathered: Vec<u8>,
}

impl<W> Sink<W> {
    /// Creates a sink for `file`.
    pub(crate) fn new(file: W) -> io::Result<Self> {
        Ok(Self { file: Arc::new(file), worker: Worker::start()?, gathered: Vec::new() })
    }
}

impl<W> ErrorType for Sink<W> {
    type Error = io::Error;
}

impl<W> Write for Sink<W>
where
    W: Send + Sync + 'static,
    for<'w> &'w W: io::Write,
{
    async fn write(&mut self, from: &[u8]) -> io::Result<usize> {
        if self.gathered.len() >= GATHERED_MAX {
            self.flush().await?;
        }
        self.gathered.extend_from_slice(from);
        Ok(from.len())
    }

    async fn flush(&mut self) -> io::Result<()> {
        if self.gathered.is_empty() {
            return Ok(());
        }
        let (file, part) = (self.file.clone(), std::mem::take(&mut self.gathered));
        let write = move || {
            let mut file = &*file;
            io::Write::write_all(&mut file, &part)?;
            io::Write::flush(&mut file)
        };
        self.worker.run(write).await
    }
}
