//! A ring buffer between an interrupt and a task: one writes, the other reads.
//!
//! embassy-hal-internal has one, too, but it takes three times as many instructions per byte, and here every interrupt brings one
//! byte.

use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicUsize, Ordering};

/// Size of a ring: two frames. A power of two, so that the counters below may wrap.
pub(crate) const RING_BYTES: usize = 512;

/// A ring of bytes.
pub(crate) struct Ring {
    bytes: [UnsafeCell<u8>; RING_BYTES],
    /// Total bytes ever written and read.
    written: AtomicUsize,
    read: AtomicUsize,
}

// SAFETY: the writer accesses a byte only before `written` counts it and after `read` does, the reader only in between.
unsafe impl Sync for Ring {}

impl Ring {
    /// An empty ring.
    pub(crate) const fn new() -> Self {
        Self {
            bytes: [const { UnsafeCell::new(0) }; RING_BYTES],
            written: AtomicUsize::new(0),
            read: AtomicUsize::new(0),
        }
    }

    /// Bytes in the buffer.
    pub(crate) fn len(&self) -> usize {
        self.written.load(Ordering::Relaxed).wrapping_sub(self.read.load(Ordering::Relaxed))
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.len() == 0
    }

    pub(crate) fn is_full(&self) -> bool {
        self.len() >= RING_BYTES
    }

    /// Appends `byte`, if there is room.
    ///
    /// # Safety
    /// No other writer at the same time.
    #[inline(always)] // runs for each byte of each line
    pub(crate) unsafe fn push(&self, byte: u8) -> bool {
        let written = self.written.load(Ordering::Relaxed);
        let has_room = written.wrapping_sub(self.read.load(Ordering::Acquire)) < RING_BYTES;
        if has_room {
            // SAFETY: there is only one writer, and the reader is done with this byte.
            unsafe { *self.bytes[written % RING_BYTES].get() = byte };
            self.written.store(written.wrapping_add(1), Ordering::Release);
        }
        has_room
    }

    /// Takes the oldest byte.
    ///
    /// # Safety
    /// No other reader at the same time.
    pub(crate) unsafe fn pop(&self) -> Option<u8> {
        // SAFETY: there is only one reader.
        let byte = unsafe { self.peek(0) };
        self.consume(usize::from(byte.is_some()));
        byte
    }

    /// The `nth` oldest byte, from 0.
    ///
    /// # Safety
    /// No other reader at the same time.
    pub(crate) unsafe fn peek(&self, nth: usize) -> Option<u8> {
        let at = self.read.load(Ordering::Relaxed).wrapping_add(nth);
        // SAFETY: the writer is done with this byte, and there is only one reader.
        let byte = || unsafe { *self.bytes[at % RING_BYTES].get() };
        (nth < self.written.load(Ordering::Acquire).wrapping_sub(self.read.load(Ordering::Relaxed)))
            .then(byte)
    }

    /// Moves bytes to `into`, and returns their number.
    ///
    /// # Safety
    /// No other reader at the same time.
    pub(crate) unsafe fn pop_into(&self, into: &mut [u8]) -> usize {
        let (read, written) = (self.read.load(Ordering::Relaxed), self.written.load(Ordering::Acquire));
        let count = written.wrapping_sub(read).min(into.len());
        let before_end = count.min(RING_BYTES - read % RING_BYTES);
        let start = self.bytes.as_ptr().cast::<u8>();
        let (first, second) = into[..count].split_at_mut(before_end);
        // SAFETY: `UnsafeCell<u8>` has the layout of `u8`; both parts are within the ring, the writer is done with them, and there
        // is only one reader.
        unsafe {
            first.as_mut_ptr().copy_from_nonoverlapping(start.add(read % RING_BYTES), first.len());
            second.as_mut_ptr().copy_from_nonoverlapping(start, second.len());
        }
        self.consume(count);
        count
    }

    fn consume(&self, count: usize) {
        self.read.store(self.read.load(Ordering::Relaxed).wrapping_add(count), Ordering::Release);
    }
}
