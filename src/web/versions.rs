//! The versions that were saved, as a stream of rows. Kept as the store tells them, ten fit where their JSON would not.

use core::fmt::{self, Write as _};

use heapless::String;

use super::json::Quoted;
use super::piece::{Piece, TEXT_BYTES_MAX, Text};
use crate::hal::Store;

/// Fits what a store tells of a version.
const VERSION_BYTES_MAX: usize = 128;
/// A board's versions all fit: the time, no number of lines, and 52 characters of who, with tabs between and an end.
const _: () = assert!(TEXT_BYTES_MAX >= 10 * ("2026-11-25T21:40:02Z\t-\t\n".len() + 52));

/// `{"versions":[{"version":0,"time":"...","lines":"+1 -1","who":"anna@192.168.1.7"}]}`
pub(super) struct Versions {
    /// A line for each.
    known: Text,
    /// The next piece: the head, a line each, the end.
    piece: usize,
}

impl Versions {
    pub(super) fn of(store: &mut impl Store) -> Self {
        let mut known = Text::new();
        for nth in 0.. {
            let mut line = String::<VERSION_BYTES_MAX>::new();
            // What does not fit is cut, and so are versions that do not.
            if store.write_version(nth, &mut line).is_none() || known.len() + line.len() >= known.capacity() {
                break;
            }
            let _ = writeln!(known, "{line}");
        }
        Self { known, piece: 0 }
    }

    /// Writes the next piece; `false`: there was none. After an error it is still the next one.
    pub(super) fn next(&mut self, out: &mut Piece) -> Result<bool, fmt::Error> {
        match self.piece.checked_sub(1) {
            None => out.write_str("{\"versions\":[")?,
            Some(nth) => {
                // An empty one behind the last.
                let mut lines = self.known.split('\n').skip(nth);
                match (lines.next(), lines.next()) {
                    (Some(line), Some(_)) => write_row(nth, line, out)?,
                    (Some(_), None) => out.write_str("]}")?,
                    (None, _) => return Ok(false),
                }
            }
        }
        self.piece += 1;
        Ok(true)
    }
}

fn write_row(nth: usize, line: &str, out: &mut Piece) -> fmt::Result {
    let mut cells = line.splitn(3, '\t');
    let [time, lines, who] = [(); 3].map(|()| Quoted(cells.next().unwrap_or_default()));
    let comma = if nth > 0 { "," } else { "" };
    write!(out, "{comma}{{\"version\":{nth},\"time\":{time},\"lines\":{lines},\"who\":{who}}}")
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::{String, ToString};

    use super::*;
    use crate::hal::StoreError;
    use crate::web::piece::ShortPiece;

    /// The longest rows that a board has.
    struct Ten(usize);

    impl Store for Ten {
        async fn read(&mut self, _: usize, _: &mut [u8]) -> Result<usize, StoreError> {
            Ok(0)
        }

        async fn append(&mut self, _: &[u8]) -> Result<(), StoreError> {
            Ok(())
        }

        async fn commit(&mut self) -> Result<(), StoreError> {
            Ok(())
        }

        fn write_version(&mut self, nth: usize, out: &mut dyn fmt::Write) -> Option<fmt::Result> {
            (nth < self.0).then(|| write!(out, "2026-11-25T21:40:02Z\t-\t{:x>52}", nth))
        }
    }

    fn json(versions: &mut Versions) -> serde_json::Value {
        let (mut json, mut piece) = (String::new(), ShortPiece::new());
        while versions.next(piece.as_mut_view()).unwrap() {
            json += piece.as_str();
            piece.clear();
        }
        serde_json::from_str(&json).unwrap()
    }

    #[test]
    fn all_versions_of_a_board_are_told_and_none_is_an_empty_list() {
        let told = json(&mut Versions::of(&mut Ten(10)));
        let rows = told["versions"].as_array().unwrap();
        assert_eq!(rows.len(), 10);
        for (nth, row) in rows.iter().enumerate() {
            assert_eq!(row["version"], nth);
            assert_eq!(row["time"], "2026-11-25T21:40:02Z");
            assert_eq!(row["lines"], "-");
            assert!(row["who"].as_str().unwrap().ends_with(&nth.to_string()));
        }
        assert_eq!(json(&mut Versions::of(&mut Ten(0))).to_string(), "{\"versions\":[]}");
    }
}
