//! Makes a frame of the MainDevice's fragments.

use embassy_time::{Duration, Instant};

use super::header::{Header, UNIT_BYTES};
use super::link::{FRAME_BYTES_MAX, FRAME_BYTES_MIN};

/// How long the MainDevice may take for a frame's next fragment: frame numbers repeat after 16.
pub const REASSEMBLY_WAIT: Duration = Duration::from_secs(1);

/// Bytes of a time behind a frame.
const TIME_BYTES: usize = 4;

/// A frame that is received.
#[derive(Debug)]
pub(super) struct Reassembly {
    buffer: [u8; FRAME_BYTES_MAX],
    length: usize,
    /// Most bytes, as the first fragment says.
    announced: usize,
    frame: u8,
    /// The number of the next fragment; `None` if only a first one fits.
    next: Option<u8>,
    /// When the last fragment came.
    since: Instant,
}

impl Reassembly {
    pub(super) const fn new() -> Self {
        Self {
            buffer: [0; FRAME_BYTES_MAX],
            length: 0,
            announced: 0,
            frame: 0,
            next: None,
            since: Instant::MIN,
        }
    }

    /// Takes a fragment, and returns the frame that it completes. One that does not fit drops the frame before it.
    pub(super) fn take(&mut self, header: Header, bytes: &[u8], now: Instant) -> Option<&[u8]> {
        let next = self.next.take();
        if header.number() == 0 {
            // IgH's MainDevice announces up to a unit more than there is.
            (self.length, self.announced, self.frame) = (0, header.offset(), header.frame());
        } else if next != Some(header.number())
            || self.frame != header.frame()
            || self.length != header.offset()
            || now >= self.since + REASSEMBLY_WAIT
        {
            return None;
        }
        let bytes = match header.is_last() && header.has_time() {
            true => bytes.split_last_chunk::<TIME_BYTES>()?.0,
            false => bytes,
        };
        let end = self.length + bytes.len();
        let whole = !bytes.is_empty() && bytes.len().is_multiple_of(UNIT_BYTES);
        if end > self.announced || !header.is_last() && !whole {
            return None;
        }
        self.buffer.get_mut(self.length..end)?.copy_from_slice(bytes);
        (self.length, self.since) = (end, now);
        if !header.is_last() {
            // One past the last number fits no fragment.
            self.next = Some(header.number() + 1);
            return None;
        }
        self.buffer.get(..end).filter(|frame| frame.len() >= FRAME_BYTES_MIN)
    }

    pub(super) fn drop_partial(&mut self) {
        self.next = None;
    }
}
