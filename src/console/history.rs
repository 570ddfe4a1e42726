//! Lines typed before, in a buffer of fixed size; the oldest are dropped.

use heapless::Vec;

/// Bytes of all lines, with a line end each.
pub(super) const HISTORY_BYTES_MAX: usize = 1_024;

/// The lines, each ended by LF.
#[derive(Debug, Default)]
pub(super) struct History(Vec<u8, HISTORY_BYTES_MAX>);

impl History {
    /// Adds `line`, unless it is empty or equal to the newest one.
    pub(super) fn push(&mut self, line: &[u8]) {
        if !line.is_empty() && self.back(1) != Some(line) {
            self.keep(line);
        }
    }

    /// Adds `line` unconditionally.
    pub(super) fn keep(&mut self, line: &[u8]) {
        if line.len() >= HISTORY_BYTES_MAX {
            return;
        }
        while self.0.len() + line.len() + 1 > HISTORY_BYTES_MAX {
            let oldest = self.0.iter().position(|&byte| byte == b'\n').map_or(self.0.len(), |at| at + 1);
            self.0.copy_within(oldest.., 0);
            self.0.truncate(self.0.len() - oldest);
        }
        let _ = self.0.extend_from_slice(line);
        let _ = self.0.push(b'\n');
    }

    /// Removes the newest line.
    pub(super) fn forget(&mut self) {
        let newest = self.back(1).map_or(0, |line| line.len() + 1);
        self.0.truncate(self.0.len() - newest);
    }

    /// The line `back` lines ago; 1 is the newest.
    pub(super) fn back(&self, back: usize) -> Option<&[u8]> {
        // After the last LF there is an empty line, number 0.
        self.0.rsplit(|&byte| byte == b'\n').nth(back)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::format;

    use super::*;

    #[test]
    fn the_newest_line_comes_first_and_repeats_are_not_kept() {
        let mut history = History::default();
        for line in ["one", "two", "two", ""] {
            history.push(line.as_bytes());
        }
        assert_eq!(history.back(1), Some(&b"two"[..]));
        assert_eq!(history.back(2), Some(&b"one"[..]));
        assert_eq!(history.back(3), None);
    }

    #[test]
    fn the_oldest_lines_make_room() {
        let mut history = History::default();
        for n in 0..1_000 {
            history.push(format!("line {n}").as_bytes());
        }
        assert_eq!(history.back(1), Some(&b"line 999"[..]));
        let kept = (1..).take_while(|&back| history.back(back).is_some()).count();
        assert_eq!(kept, HISTORY_BYTES_MAX / 9);
        assert_eq!(history.back(kept), Some(format!("line {}", 1_000 - kept).as_bytes()));
        history.push(&[b'x'; HISTORY_BYTES_MAX - 1]);
        assert_eq!(history.back(2), None);
    }
}
