//! The versions that were saved, as a stream of rows. Kept as the store tells them, ten fit where their JSON would not.

use core::fmt::{self, Write as _};

use super::json::Quoted;
use super::piece::{Piece, TEXT_BYTES_MAX, Text};
use crate::hal::Store;

/// A board's versions all fit: the time, no number of lines, and 52 characters of who, with tabs between and an end.
const _: () = assert!(TEXT_BYTES_MAX >= 10 * ("2026-11-25T21:40:02Z\t-\t\n".len() + 52));

/// `{"versions":[{"version":0,"time":"...","lines":"+1 -1","who":"anna@192.168.1.7"}]}`
pub(super) struct Versions {
    /// A line for each.
    known: Text,
    /// Where the next one begins in it.
    at: u16,
    stage: Stage,
}

/// What comes next.
#[derive(Clone, Copy)]
enum Stage {
    Head,
    Row(u8),
    Nothing,
}

impl Versions {
    pub(super) fn of(store: &mut impl Store) -> Self {
        let mut known = Text::new();
        for nth in 0.. {
            let length = known.len();
            let written = store.write_version(nth, &mut known).and_then(Result::ok);
            // Those that do not fit are left out.
            if written.is_none() || known.push('\n').is_err() {
                known.truncate(length);
                break;
            }
        }
        Self { known, at: 0, stage: Stage::Head }
    }

    /// Writes the next piece; `false`: there was none. After an error it is still the next one.
    pub(super) fn next(&mut self, out: &mut Piece) -> Result<bool, fmt::Error> {
        self.stage = match self.stage {
            Stage::Head => {
                out.write_str("{\"versions\":[")?;
                Stage::Row(0)
            }
            Stage::Row(nth) => {
                match self.known.get(usize::from(self.at)..).and_then(|rest| rest.split_once('\n')) {
                    Some((line, _)) => {
                        write_row(nth, line, out)?;
                        self.at += line.len() as u16 + 1;
                        Stage::Row(nth + 1)
                    }
                    None => {
                        out.write_str("]}")?;
                        Stage::Nothing
                    }
                }
            }
            Stage::Nothing => return Ok(false),
        };
        Ok(true)
    }
}

fn write_row(nth: u8, line: &str, out: &mut Piece) -> fmt::Result {
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
