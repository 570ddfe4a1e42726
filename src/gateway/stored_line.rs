//! The line that is loaded or saved: one for all consoles and connections of the web interface, because it is long.

use core::ops::DerefMut;

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::mutex::Mutex;

use crate::language::LineBuffer;

/// Memory for the line.
pub(super) struct StoredLine(Mutex<CriticalSectionRawMutex, LineBuffer>);

impl StoredLine {
    pub(super) const fn new() -> Self {
        Self(Mutex::new(LineBuffer::new()))
    }

    /// The memory, whatever its content.
    pub(super) async fn lock(&self) -> impl DerefMut<Target = LineBuffer> + '_ {
        self.0.lock().await
    }
}
