//! Lines of the audit trail in a ring of bytes, since most lines are short: pure, with time as a value.
//!
//! The memory may be one that a reset leaves alone. Each line has a check sum, and a line is written before it is counted in: whatever
//! happens between two instructions, earlier lines stay intact.

use core::cell::Cell;

use crc::{CRC_32_ISO_HDLC, Crc, Digest, NoTable};
use heapless::{String, Vec};

use super::line::AUDIT_BYTES_MAX;
use super::stamp::Stamp;
use super::topic::Topic;

/// Number, time, topic and length before each text.
const HEAD_BYTES: usize = 4 + 8 + 1 + 2;
/// The check sum behind it.
const SUM_BYTES: usize = 4;

const CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// A line in a ring, without its text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) number: u32,
    pub(super) stamp: Stamp,
    pub(super) topic: Topic,
    /// Where it is, and the length of its text.
    at: usize,
    length: usize,
}

impl Entry {
    fn bytes(&self) -> usize {
        HEAD_BYTES + self.length + SUM_BYTES
    }
}

/// The newest lines that fit `N` bytes, oldest first. Any content is valid; [`resume`](Self::resume) must run first.
#[repr(C)]
pub(super) struct Ring<const N: usize> {
    /// Where the oldest line begins, times 2^16, and the length of all lines: one word, which is written at once.
    span: Cell<u32>,
    bytes: [Cell<u8>; N],
}

impl<const N: usize> Ring<N> {
    pub(super) const fn new() -> Self {
        assert!(N < 1 << 16);
        Self { span: Cell::new(0), bytes: [const { Cell::new(0) }; N] }
    }

    /// Keeps the intact, ordered lines from before a reset, and drops the others. Returns the number of the last one.
    pub(super) fn resume(&self) -> u32 {
        let (start, length) = self.span();
        // After power-up it may be anywhere.
        let start = if start < N { start } else { 0 };
        let (mut whole, mut last) = (0, 0);
        if length <= N {
            while let Some(entry) = self.entry(start + whole, length - whole)
                && entry.number > last
                && self.is_whole(&entry)
            {
                (whole, last) = (whole + entry.bytes(), entry.number);
            }
        }
        self.set_span(start, whole);
        last
    }

    /// Appends a line, and drops the oldest ones until it fits.
    pub(super) fn push(&self, number: u32, stamp: Stamp, topic: Topic, text: &str) {
        let Ok(length) = u16::try_from(text.len()) else { return };
        let bytes = HEAD_BYTES + text.len() + SUM_BYTES;
        let (mut start, mut all) = self.span();
        while N - all < bytes {
            let Some(first) = self.entries().next().map(|first| first.bytes()) else { return };
            (start, all) = ((start + first) % N, all - first);
            self.set_span(start, all);
        }
        let mut writer = Writer { ring: self, at: start + all, digest: CRC.digest() };
        writer.write(&number.to_le_bytes());
        writer.write(&stamp.number().to_le_bytes());
        writer.write(&[topic as u8]);
        writer.write(&length.to_le_bytes());
        writer.write(text.as_bytes());
        writer.finish();
        self.set_span(start, all + bytes);
    }

    /// Gives the lines from number `first` on the stamp that `other` has for theirs.
    pub(super) fn restamp(&self, first: u32, other: impl Fn(Stamp) -> Stamp) {
        for entry in self.entries().filter(|entry| entry.number >= first) {
            let mut digest = CRC.digest();
            let stamp = other(entry.stamp).number().to_le_bytes();
            for (nth, byte) in stamp.into_iter().enumerate() {
                self.set(entry.at + 4 + nth, byte);
            }
            (0..HEAD_BYTES + entry.length).for_each(|nth| digest.update(&[self.get(entry.at + nth)]));
            Writer { ring: self, at: entry.at + HEAD_BYTES + entry.length, digest }.finish();
        }
    }

    /// The lines, oldest first.
    pub(super) fn entries(&self) -> impl Iterator<Item = Entry> {
        let (mut start, mut length) = self.span();
        core::iter::from_fn(move || {
            let entry = self.entry(start, length)?;
            (start, length) = (start + entry.bytes(), length - entry.bytes());
            Some(entry)
        })
    }

    /// The text of a line.
    pub(super) fn text(&self, entry: &Entry) -> String<AUDIT_BYTES_MAX> {
        let bytes = (0..entry.length.min(AUDIT_BYTES_MAX)).map(|nth| self.get(entry.at + HEAD_BYTES + nth));
        String::from_utf8(bytes.collect::<Vec<u8, AUDIT_BYTES_MAX>>()).unwrap_or_default()
    }

    /// The line at `at`, if there is one within `room` bytes.
    fn entry(&self, at: usize, room: usize) -> Option<Entry> {
        if room < HEAD_BYTES + SUM_BYTES {
            return None;
        }
        let number = u32::from_le_bytes(self.array(at));
        let stamp = Stamp::of(u64::from_le_bytes(self.array(at + 4)));
        let topic = Topic::of(self.get(at + 12))?;
        let length = u16::from_le_bytes(self.array(at + 13)).into();
        let entry = Entry { number, stamp, topic, at, length };
        (entry.bytes() <= room).then_some(entry)
    }

    fn is_whole(&self, entry: &Entry) -> bool {
        let mut digest = CRC.digest();
        let end = entry.at + HEAD_BYTES + entry.length;
        (entry.at..end).for_each(|at| digest.update(&[self.get(at)]));
        digest.finalize() == u32::from_le_bytes(self.array(end))
    }

    fn array<const M: usize>(&self, at: usize) -> [u8; M] {
        core::array::from_fn(|nth| self.get(at + nth))
    }

    fn get(&self, at: usize) -> u8 {
        self.bytes.get(at % N).map_or(0, Cell::get)
    }

    fn set(&self, at: usize, byte: u8) {
        if let Some(cell) = self.bytes.get(at % N) {
            cell.set(byte);
        }
    }

    fn span(&self) -> (usize, usize) {
        let span = self.span.get();
        ((span >> 16) as usize, (span & 0xffff) as usize)
    }

    fn set_span(&self, start: usize, length: usize) {
        self.span.set((start << 16 | length) as u32);
    }
}

/// Writes bytes and their check sum.
struct Writer<'r, const N: usize> {
    ring: &'r Ring<N>,
    at: usize,
    digest: Digest<'static, u32, NoTable>,
}

impl<const N: usize> Writer<'_, N> {
    fn write(&mut self, bytes: &[u8]) {
        self.digest.update(bytes);
        self.put(bytes);
    }

    fn put(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.ring.set(self.at, byte);
            self.at += 1;
        }
    }

    fn finish(mut self) {
        let sum = self.digest.clone().finalize();
        self.put(&sum.to_le_bytes());
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::format;
    use std::string::String;
    use std::vec::Vec;

    use embassy_time::Instant;

    use super::*;
    use crate::gateway::date::Date;

    const UP: Stamp = Stamp::Up(Instant::from_ticks(7));

    fn lines<const N: usize>(ring: &Ring<N>) -> Vec<(u32, String)> {
        ring.entries().map(|entry| (entry.number, ring.text(&entry).as_str().into())).collect()
    }

    #[test]
    fn a_ring_has_the_newest_lines_that_fit() {
        let ring = Ring::<110>::new();
        for number in 1..50 {
            ring.push(number, UP, Topic::Save, &format!("line {number}"));
            let last: Vec<_> = ring.entries().map(|entry| entry.number).collect();
            assert!(last.windows(2).all(|pair| pair[0] + 1 == pair[1]), "{last:?}");
            assert_eq!(last.last(), Some(&number));
        }
        let four: Vec<_> = (46..50).map(|number| (number, format!("line {number}"))).collect();
        assert_eq!(lines(&ring), four, "four of 26 bytes fit");
        assert!(ring.entries().all(|entry| entry.stamp == UP && entry.topic == Topic::Save));
        ring.push(50, UP, Topic::Save, &"x".repeat(91));
        assert_eq!(ring.entries().count(), 1);
        ring.push(51, UP, Topic::Save, &"x".repeat(92));
        assert_eq!(ring.entries().count(), 0, "a line that never fits leaves nothing old behind");
    }

    #[test]
    fn a_reset_leaves_the_lines_up_to_the_first_one_that_is_corrupt() {
        let ring = Ring::<200>::new();
        (1..20).for_each(|number| ring.push(number, UP, Topic::Unit, &format!("line {number}")));
        let before = lines(&ring);
        assert_eq!(ring.resume(), 19);
        assert_eq!(lines(&ring), before);
        let third = ring.entries().nth(2).unwrap();
        ring.set(third.at + HEAD_BYTES, b'?');
        assert_eq!(ring.resume(), third.number - 1);
        assert_eq!(lines(&ring), before[..2]);
        ring.push(third.number, UP, Topic::Unit, "and on");
        assert_eq!(lines(&ring).last(), Some(&(third.number, "and on".into())));
    }

    /// Memory contents after power-up.
    #[test]
    fn random_memory_has_no_lines_and_takes_some() {
        let mut seed = 0x2545_f491_4f6c_dd1d_u64;
        for _ in 0..200 {
            let ring = Ring::<100>::new();
            let mut random = || {
                seed ^= seed << 13;
                seed ^= seed >> 7;
                seed ^= seed << 17;
                seed
            };
            ring.bytes.iter().for_each(|byte| byte.set(random() as u8));
            ring.span.set(random() as u32);
            assert_eq!(ring.resume(), 0);
            assert_eq!(ring.entries().count(), 0);
            ring.push(1, UP, Topic::Start, "start");
            assert_eq!(lines(&ring), [(1, "start".into())]);
            assert_eq!(ring.resume(), 1, "a reset leaves the line alone");
        }
    }

    #[test]
    fn lines_get_their_dates_once_the_time_is_known() {
        let ring = Ring::<200>::new();
        (1..9).for_each(|number| ring.push(number, UP, Topic::Save, "save"));
        ring.restamp(7, |stamp| match stamp {
            Stamp::Up(at) => Stamp::Date(Date(1_000_000 + at.as_ticks())),
            date => date,
        });
        let stamps: Vec<_> = ring.entries().map(|entry| entry.stamp).collect();
        assert_eq!(
            stamps[stamps.len() - 3..],
            [UP, Stamp::Date(Date(1_000_007)), Stamp::Date(Date(1_000_007))]
        );
        assert_eq!(ring.resume(), 8, "whole as before");
    }
}
