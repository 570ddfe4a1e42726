//! A ring buffer for the bytes of captured frames, added and removed frame by frame.

use heapless::Vec;

/// Size of the buffer.
const BYTES_MAX: usize = if cfg!(feature = "small") { 1_024 } else { 2_048 };

/// A queue of bytes.
pub(super) struct Bytes {
    bytes: [u8; BYTES_MAX],
    /// Position of the oldest byte, and number of bytes.
    start: usize,
    length: usize,
}

impl Bytes {
    /// An empty buffer.
    pub(super) const fn new() -> Self {
        Self { bytes: [0; BYTES_MAX], start: 0, length: 0 }
    }

    /// Number of free bytes.
    pub(super) const fn room(&self) -> usize {
        BYTES_MAX - self.length
    }

    /// Drops the oldest `count` bytes.
    pub(super) fn drop_oldest(&mut self, count: usize) {
        let count = count.min(self.length);
        self.start = (self.start + count) % BYTES_MAX;
        self.length -= count;
    }

    /// Appends `bytes`, which must fit.
    pub(super) fn append(&mut self, bytes: &[u8]) {
        let end = (self.start + self.length) % BYTES_MAX;
        let (before, behind) = bytes.split_at(bytes.len().min(BYTES_MAX - end));
        for (at, part) in [(end, before), (0, behind)] {
            if let Some(place) = self.bytes.get_mut(at..at + part.len()) {
                place.copy_from_slice(part);
            }
        }
        self.length += bytes.len();
    }

    /// Copies `count` bytes, or as many as fit, starting after the oldest `before`.
    pub(super) fn get<const N: usize>(&self, before: usize, count: usize) -> Vec<u8, N> {
        self.bytes
            .iter()
            .cycle()
            .skip((self.start + before) % BYTES_MAX)
            .take(count.min(N))
            .copied()
            .collect()
    }
}
