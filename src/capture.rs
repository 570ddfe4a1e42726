//! Capture: the last frames as transferred on the wire, in a bounded ring that can be followed while it fills.
//!
//! A frame is stored with the time of its last bit, its direction, and its outcome, named like the counters. Frames of serial lines
//! are always stored; those of networks only while the ring is being followed, since they are more numerous and cost time. A
//! follower that polls too rarely misses frames, which are counted.

use core::cell::{Cell, RefCell};
use core::iter::repeat_n;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_time::Instant;
use heapless::{Deque, Vec};
use portable_atomic::{AtomicU8, Ordering};

use crate::modbus::ascii::FRAME_CHARS_MAX;
use crate::modbus::tcp::ADU_BYTES_MAX;
use crate::settings::{Framing, PortId, StreamFraming};
use crate::stats::Event;

mod bytes;
mod export;
mod pcapng;

use self::bytes::Bytes;
pub use self::export::Export;

/// Whether frames are stored; without the feature `capture` nothing here takes memory.
pub const CAPTURE: bool = cfg!(feature = "capture");
/// Frames in the ring; half as many with the feature `small`.
pub const FRAMES_MAX: usize = if cfg!(feature = "small") { 32 } else { 64 };

/// Bytes of a frame that are read from the ring at a time: all, or with the feature `small` those of the longest frame that is
/// not ASCII, because each connection may hold as many.
const PART_BYTES_MAX: usize = match (CAPTURE, cfg!(feature = "small")) {
    (false, _) => 0,
    (true, false) => FRAME_CHARS_MAX,
    (true, true) => ADU_BYTES_MAX,
};

/// The framing of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameKind {
    /// RTU, on a serial line or in a TCP stream.
    Rtu,
    /// ASCII.
    Ascii,
    /// Modbus TCP.
    Tcp,
    /// Modbus TCP over UDP.
    Udp,
}

/// A frame's header in the capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Head {
    /// Time of its last bit, as far as the gateway knows.
    pub at: Instant,
    /// The port.
    pub port: PortId,
    /// Its framing.
    pub kind: FrameKind,
    /// The requester's TCP or UDP port, which distinguishes conversations; for requests of the gateway or a serial master, the
    /// number of the gateway's port, from 1.
    pub requester: u16,
    /// Whether the gateway sent it.
    pub sent: bool,
    /// A request, a response, or the fault.
    pub verdict: Event,
    length: u16,
}

/// A frame of the ring.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Captured {
    /// Its header.
    pub head: Head,
    /// The bytes on the wire: the first part, or the next one of a frame that is read in parts.
    pub bytes: Vec<u8, PART_BYTES_MAX>,
    /// Frames lost between the previous one and this one.
    pub missed: u32,
    number: u32,
    /// Bytes before the part.
    before: u16,
}

impl Captured {
    /// All bytes on the wire.
    pub(crate) fn length(&self) -> usize {
        self.head.length.into()
    }
}

/// The capture ring.
pub struct Capture {
    ring: Mutex<CriticalSectionRawMutex, RefCell<Ring>>,
    followers: AtomicU8,
    epoch_us: Mutex<CriticalSectionRawMutex, Cell<u64>>,
}

struct Ring {
    heads: Deque<Head, FRAMES_MAX>,
    bytes: Bytes,
    /// Number of the oldest frame.
    first: u32,
}

impl Capture {
    /// An empty ring.
    pub const fn new() -> Self {
        let ring = Ring { heads: Deque::new(), bytes: Bytes::new(), first: 0 };
        Self {
            ring: Mutex::new(RefCell::new(ring)),
            followers: AtomicU8::new(0),
            epoch_us: Mutex::new(Cell::new(0)),
        }
    }

    /// Sets the start of the gateway's clock, in microseconds since 1970; without it, times count from the start of the clock.
    pub fn set_epoch(&self, epoch_us: u64) {
        self.epoch_us.lock(|epoch| epoch.set(epoch_us));
    }

    /// Follows the ring from now on; meanwhile frames of networks are stored too.
    pub fn follow(&self) -> Following<'_> {
        self.followers.fetch_add(1, Ordering::Relaxed);
        Following { capture: self, cursor: self.end() }
    }

    /// The number of the next frame.
    pub fn end(&self) -> u32 {
        self.ring.lock(|ring| ring.borrow().end())
    }

    /// The number of the oldest frame.
    #[cfg(feature = "files")] // As what uses it.
    fn first(&self) -> u32 {
        self.ring.lock(|ring| ring.borrow().first)
    }

    /// Returns the frame with number `cursor`, or the oldest one after it, and advances the cursor.
    pub fn next(&self, cursor: &mut u32) -> Option<Captured> {
        self.ring.lock(|ring| ring.borrow().get(cursor))
    }

    /// Reads the next part of `frame`, if there is one. If the frame has been overwritten meanwhile, its rest is zeros.
    pub(crate) fn next_part(&self, frame: &mut Captured) -> bool {
        self.ring.lock(|ring| ring.borrow().next_part(frame))
    }

    fn record(&self, head: Head, parts: &[&[u8]]) {
        self.ring.lock(|ring| ring.borrow_mut().push(head, parts));
    }
}

/// A follower of the ring.
pub struct Following<'c> {
    capture: &'c Capture,
    cursor: u32,
}

/// Ends when there is no frame yet; more may follow.
impl Iterator for Following<'_> {
    type Item = Captured;

    fn next(&mut self) -> Option<Captured> {
        self.capture.next(&mut self.cursor)
    }
}

impl Drop for Following<'_> {
    fn drop(&mut self) {
        self.capture.followers.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Ring {
    fn end(&self) -> u32 {
        self.first.wrapping_add(self.heads.len() as u32)
    }

    fn push(&mut self, head: Head, parts: &[&[u8]]) {
        while self.heads.is_full() || self.bytes.room() < head.length.into() {
            let Some(oldest) = self.heads.pop_front() else { return };
            self.bytes.drop_oldest(oldest.length.into());
            self.first = self.first.wrapping_add(1);
        }
        // Room was made above.
        let _ = self.heads.push_back(head);
        parts.iter().for_each(|part| self.bytes.append(part));
    }

    fn get(&self, cursor: &mut u32) -> Option<Captured> {
        let ahead = self.end().wrapping_sub(*cursor) as usize;
        let at = self.heads.len().saturating_sub(ahead);
        if ahead == 0 {
            return None;
        }
        let head = *self.heads.iter().nth(at)?;
        let number = self.first.wrapping_add(at as u32);
        let missed = number.wrapping_sub(*cursor);
        *cursor = number.wrapping_add(1);
        let bytes = self.part(at, 0, head.length);
        Some(Captured { head, bytes, missed, number, before: 0 })
    }

    fn next_part(&self, frame: &mut Captured) -> bool {
        frame.before += frame.bytes.len() as u16;
        let left = frame.head.length.saturating_sub(frame.before);
        let at = frame.number.wrapping_sub(self.first) as usize;
        frame.bytes = if at < self.heads.len() {
            self.part(at, frame.before, left)
        } else {
            repeat_n(0, left.into()).take(PART_BYTES_MAX).collect()
        };
        left > 0
    }

    /// Of frame `at` so many bytes behind the first `before`, or as many as are read at a time.
    fn part(&self, at: usize, before: u16, count: u16) -> Vec<u8, PART_BYTES_MAX> {
        let start: usize = self.heads.iter().take(at).map(|head| usize::from(head.length)).sum();
        self.bytes.get(start + usize::from(before), count.into())
    }
}

/// Records the frames of one port, if the board has a capture ring.
#[derive(Clone, Copy)]
pub(crate) struct Tap<'g> {
    pub(crate) capture: Option<&'g Capture>,
    pub(crate) port: PortId,
    pub(crate) kind: FrameKind,
}

impl Tap<'_> {
    /// Records a frame sent on a line, whose last bit leaves at `at`.
    pub(crate) fn sent(&self, at: Instant, verdict: Event, bytes: &[u8]) {
        self.record(at, self.requester(), true, verdict, bytes);
    }

    /// Records a frame that was cut through to a line; in RTU with its received CRC, if known.
    pub(crate) fn forwarded(
        &self,
        at: Instant,
        verdict: Event,
        framing: Framing,
        (unit, pdu): (u8, &[u8]),
        (crc, delimiter): (Option<u16>, u8),
    ) {
        match (framing, crc) {
            _ if self.capture.is_none() => {}
            (Framing::Rtu, Some(crc)) => {
                self.record_parts(at, self.requester(), true, verdict, &[&[unit], pdu, &crc.to_le_bytes()]);
            }
            _ => {
                let mut frame = [0; FRAME_CHARS_MAX];
                let frame = framing.encode(unit, pdu, delimiter, &mut frame);
                self.sent(at, verdict, frame.unwrap_or(&[]));
            }
        }
    }

    /// Records what was received from a line until `at`.
    pub(crate) fn received(&self, at: Instant, verdict: Event, bytes: &[u8]) {
        self.record(at, self.requester(), false, verdict, bytes);
    }

    /// The requester on a line: its master, or the gateway.
    pub(crate) fn requester(&self) -> u16 {
        u16::from(self.port.0) + 1
    }

    /// Records a frame on a network, in a conversation with the requester's port `requester`, if the ring is being followed.
    /// `requester` is only called in that case.
    pub(crate) fn passed(&self, requester: impl FnOnce() -> u16, sent: bool, verdict: Event, bytes: &[u8]) {
        if self.capture.is_some_and(|capture| capture.followers.load(Ordering::Relaxed) > 0) {
            self.record(Instant::now(), requester(), sent, verdict, bytes);
        }
    }

    fn record(&self, at: Instant, requester: u16, sent: bool, verdict: Event, bytes: &[u8]) {
        self.record_parts(at, requester, sent, verdict, &[bytes.get(..FRAME_CHARS_MAX).unwrap_or(bytes)]);
    }

    fn record_parts(&self, at: Instant, requester: u16, sent: bool, verdict: Event, parts: &[&[u8]]) {
        let length = parts.iter().map(|part| part.len()).sum::<usize>() as u16;
        let Some(capture) = self.capture.filter(|_| length > 0) else { return };
        let Self { port, kind, .. } = *self;
        capture.record(Head { at, port, kind, requester, sent, verdict, length }, parts);
    }
}

impl From<Framing> for FrameKind {
    fn from(framing: Framing) -> Self {
        match framing {
            Framing::Rtu => Self::Rtu,
            Framing::Ascii => Self::Ascii,
        }
    }
}

impl From<StreamFraming> for FrameKind {
    fn from(framing: StreamFraming) -> Self {
        match framing {
            StreamFraming::Rtu => Self::Rtu,
            StreamFraming::Mbap | StreamFraming::Capture | StreamFraming::Ssh => Self::Tcp,
        }
    }
}
