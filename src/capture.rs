//! The last frames of the serial lines as they were on the wire: a ring of bounded size that can be followed while it fills.
//!
//! A frame is kept with the time of its last bit, its direction, and what became of it, in the words of the counters. Who follows the
//! ring looks at it often enough; what was overwritten before that is missing, and counted.

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_time::Instant;
use heapless::{Deque, Vec};

use crate::config::{Framing, PortId};
use crate::port::framing::FRAME_CHARS_MAX;
use crate::stats::Event;

pub mod pcapng;

/// Frames that the ring remembers.
pub const FRAMES_MAX: usize = 64;
/// Bytes of them all.
pub const BYTES_MAX: usize = 2_048;

/// What is known of a frame besides its bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Head {
    /// When its last bit had passed, as far as the gateway knows.
    pub at: Instant,
    /// The line it was on.
    pub port: PortId,
    /// RTU or ASCII.
    pub framing: Framing,
    /// Whether the gateway sent it.
    pub sent: bool,
    /// A request, an answer, or what is wrong with it.
    pub verdict: Event,
    length: usize,
}

/// A frame of the ring.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Captured {
    /// What is known of it.
    pub head: Head,
    /// What was on the wire.
    pub bytes: Vec<u8, FRAME_CHARS_MAX>,
    /// Frames between this one and the one that was looked at before, which are lost.
    pub missed: u32,
}

/// The ring.
pub struct Capture(Mutex<CriticalSectionRawMutex, RefCell<Ring>>);

struct Ring {
    heads: Deque<Head, FRAMES_MAX>,
    bytes: [u8; BYTES_MAX],
    /// Where the oldest one's bytes are, and how many there are of all.
    start: usize,
    length: usize,
    /// The number of the oldest one.
    first: u32,
}

impl Capture {
    /// An empty ring.
    pub const fn new() -> Self {
        Self(Mutex::new(RefCell::new(Ring {
            heads: Deque::new(),
            bytes: [0; BYTES_MAX],
            start: 0,
            length: 0,
            first: 0,
        })))
    }

    /// The number of the frame that comes next.
    pub fn end(&self) -> u32 {
        self.0.lock(|ring| ring.borrow().end())
    }

    /// Takes the frame with the number `cursor`, or the oldest there is behind it, and moves on.
    pub fn next(&self, cursor: &mut u32) -> Option<Captured> {
        self.0.lock(|ring| ring.borrow().get(cursor))
    }

    fn record(&self, head: Head, parts: &[&[u8]]) {
        self.0.lock(|ring| ring.borrow_mut().push(head, parts));
    }
}

impl Default for Capture {
    fn default() -> Self {
        Self::new()
    }
}

impl Ring {
    fn end(&self) -> u32 {
        self.first.wrapping_add(self.heads.len() as u32)
    }

    fn push(&mut self, head: Head, parts: &[&[u8]]) {
        while self.heads.is_full() || BYTES_MAX - self.length < head.length {
            let Some(oldest) = self.heads.pop_front() else { return };
            self.start = (self.start + oldest.length) % BYTES_MAX;
            self.length -= oldest.length;
            self.first = self.first.wrapping_add(1);
        }
        // There is room now.
        let _ = self.heads.push_back(head);
        parts.iter().for_each(|part| self.append(part));
    }

    fn append(&mut self, bytes: &[u8]) {
        let end = (self.start + self.length) % BYTES_MAX;
        let (before, behind) = bytes.split_at(bytes.len().min(BYTES_MAX - end));
        for (place, part) in [(end, before), (0, behind)] {
            if let Some(room) = self.bytes.get_mut(place..place + part.len()) {
                room.copy_from_slice(part);
            }
        }
        self.length += bytes.len();
    }

    fn get(&self, cursor: &mut u32) -> Option<Captured> {
        let ahead = self.end().wrapping_sub(*cursor) as usize;
        let at = self.heads.len().saturating_sub(ahead);
        if ahead == 0 {
            return None;
        }
        let head = *self.heads.iter().nth(at)?;
        let before: usize = self.heads.iter().take(at).map(|head| head.length).sum();
        let bytes = self.bytes.iter().cycle().skip((self.start + before) % BYTES_MAX);
        let bytes = bytes.take(head.length).copied().collect();
        let number = self.first.wrapping_add(at as u32);
        let missed = number.wrapping_sub(*cursor);
        *cursor = number.wrapping_add(1);
        Some(Captured { head, bytes, missed })
    }
}

/// Where the frames of one line are recorded, if the board has room for that.
#[derive(Clone, Copy)]
pub(crate) struct Tap<'g> {
    pub(crate) capture: Option<&'g Capture>,
    pub(crate) port: PortId,
    pub(crate) framing: Framing,
}

impl Tap<'_> {
    /// Records a frame that the gateway has sent, whose last bit leaves at `at`.
    pub(crate) fn sent(&self, at: Instant, verdict: Event, bytes: &[u8]) {
        self.record(at, true, verdict, bytes);
    }

    /// Records a frame that the gateway has sent under `unit` while it arrived: with the CRC that came, if there is one.
    pub(crate) fn copied(
        &self,
        at: Instant,
        verdict: Event,
        unit: u8,
        pdu: &[u8],
        (crc, delimiter): (Option<u16>, u8),
    ) {
        match crc {
            _ if self.capture.is_none() => {}
            Some(crc) if self.framing == Framing::Rtu => {
                self.record_parts(at, true, verdict, &[&[unit], pdu, &crc.to_le_bytes()]);
            }
            _ => {
                let mut frame = [0; FRAME_CHARS_MAX];
                let frame = self.framing.encode(unit, pdu, delimiter, &mut frame);
                self.sent(at, verdict, frame.unwrap_or(&[]));
            }
        }
    }

    /// Records what was heard until `at`.
    pub(crate) fn heard(&self, at: Instant, verdict: Event, bytes: &[u8]) {
        self.record(at, false, verdict, bytes);
    }

    fn record(&self, at: Instant, sent: bool, verdict: Event, bytes: &[u8]) {
        self.record_parts(at, sent, verdict, &[bytes.get(..FRAME_CHARS_MAX).unwrap_or(bytes)]);
    }

    fn record_parts(&self, at: Instant, sent: bool, verdict: Event, parts: &[&[u8]]) {
        let length = parts.iter().map(|part| part.len()).sum();
        let Some(capture) = self.capture.filter(|_| length > 0) else { return };
        let Self { port, framing, .. } = *self;
        capture.record(Head { at, port, framing, sent, verdict, length }, parts);
    }
}
