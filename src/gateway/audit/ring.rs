//! Lines of the audit trail in a ring of bytes, since most lines are short: pure, with time as a value.

use embassy_time::Instant;
use heapless::Vec;

use super::topic::Topic;

/// Number, time, topic and length before each text.
const HEAD_BYTES: usize = 4 + 8 + 1 + 2;

/// A line in a ring.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Entry<'r> {
    pub(super) number: u32,
    pub(super) at: Instant,
    pub(super) topic: Topic,
    pub(super) text: &'r str,
}

impl<'r> Entry<'r> {
    /// The first line in `bytes`, and the bytes behind it.
    fn split(bytes: &'r [u8]) -> Option<(Self, &'r [u8])> {
        let (number, rest) = bytes.split_first_chunk()?;
        let (ticks, rest) = rest.split_first_chunk()?;
        let (&[topic], rest) = rest.split_first_chunk()?;
        let (length, rest) = rest.split_first_chunk()?;
        let (text, rest) = rest.split_at_checked(u16::from_le_bytes(*length).into())?;
        let entry = Self {
            number: u32::from_le_bytes(*number),
            at: Instant::from_ticks(u64::from_le_bytes(*ticks)),
            topic: Topic::of(topic)?,
            text: core::str::from_utf8(text).ok()?,
        };
        Some((entry, rest))
    }
}

/// The newest lines that fit `N` bytes, oldest first.
pub(super) struct Ring<const N: usize>(Vec<u8, N>);

impl<const N: usize> Ring<N> {
    pub(super) const fn new() -> Self {
        Self(Vec::new())
    }

    /// Appends a line, and drops the oldest ones until it fits.
    pub(super) fn push(&mut self, entry: Entry<'_>) {
        let Ok(length) = u16::try_from(entry.text.len()) else { return };
        let bytes = HEAD_BYTES + entry.text.len();
        while N - self.0.len() < bytes {
            let Some(first) = self.entries().next().map(|first| HEAD_BYTES + first.text.len()) else {
                return;
            };
            self.0.rotate_left(first);
            self.0.truncate(self.0.len() - first);
        }
        // Room was made above.
        let _ = self.0.extend_from_slice(&entry.number.to_le_bytes());
        let _ = self.0.extend_from_slice(&entry.at.as_ticks().to_le_bytes());
        let _ = self.0.push(entry.topic as u8);
        let _ = self.0.extend_from_slice(&length.to_le_bytes());
        let _ = self.0.extend_from_slice(entry.text.as_bytes());
    }

    /// The lines, oldest first.
    pub(super) fn entries(&self) -> impl Iterator<Item = Entry<'_>> {
        let mut rest = self.0.as_slice();
        core::iter::from_fn(move || {
            let (entry, behind) = Entry::split(rest)?;
            rest = behind;
            Some(entry)
        })
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::format;
    use std::vec::Vec;

    use super::*;

    fn entry(number: u32, text: &str) -> Entry<'_> {
        Entry { number, at: Instant::from_ticks(7), topic: Topic::Save, text }
    }

    #[test]
    fn a_ring_has_the_newest_lines_that_fit() {
        let mut ring = Ring::<100>::new();
        for number in 0..50 {
            ring.push(entry(number, &format!("line {number}")));
            let last: Vec<_> = ring.entries().map(|entry| entry.number).collect();
            assert!(last.windows(2).all(|pair| pair[0] + 1 == pair[1]), "{last:?}");
            assert_eq!(last.last(), Some(&number));
        }
        assert_eq!(ring.entries().next(), Some(entry(46, "line 46")), "four of 22 bytes fit");
        ring.push(entry(50, &"x".repeat(85)));
        assert_eq!(ring.entries().count(), 1);
        ring.push(entry(51, &"x".repeat(86)));
        assert_eq!(ring.entries().count(), 0, "a line that never fits leaves nothing old behind");
    }
}
