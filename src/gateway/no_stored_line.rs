//! The line that is loaded or saved, in images without the web interface: each console has its own, as few others load or save.

use core::ops::{Deref, DerefMut};

use crate::language::LineBuffer;

/// No memory is shared.
pub(super) struct StoredLine;

struct Own(LineBuffer);

impl StoredLine {
    pub(super) const fn new() -> Self {
        Self
    }

    /// Memory for the line.
    pub(super) async fn lock(&self) -> impl DerefMut<Target = LineBuffer> + use<> {
        Own(LineBuffer::new())
    }
}

impl Deref for Own {
    type Target = LineBuffer;

    fn deref(&self) -> &LineBuffer {
        &self.0
    }
}

impl DerefMut for Own {
    fn deref_mut(&mut self) -> &mut LineBuffer {
        &mut self.0
    }
}
