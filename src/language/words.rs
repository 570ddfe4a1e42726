//! The words of a line, with their columns for errors.
//!
//! Blanks, tabs and commas separate words; `#` at the start of a word begins a comment. Commas are recorded, since a list
//! (`functions 3,4,16`) continues as long as there are commas.

use core::cell::Cell;

use heapless::String;

use super::problem::{LineError, Problem, WORD_BYTES_MAX, cut};

/// One word, or the end of the line when `text` is empty.
#[derive(Clone, Copy)]
pub(crate) struct Word<'a> {
    /// The word as written in the line.
    pub(crate) text: &'a str,
    /// Where it starts, in characters from 1.
    pub(crate) column: usize,
    /// Whether a comma precedes it.
    pub(crate) listed: bool,
    wrong: &'a Cell<Option<LineError>>,
}

/// The keywords of a table by index, independent of the type of its values.
pub(crate) type Keywords<'t> = &'t dyn Fn(usize) -> Option<&'static str>;

/// A word is wrong; [`Words::wrong`] has the details. Empty, since nearly every parsing function may fail, and errors pass through
/// many of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Wrong;

impl Word<'_> {
    /// Whether this is the end of the line.
    pub(crate) fn is_end(&self) -> bool {
        self.text.is_empty()
    }

    /// Whether this is `keyword`, ignoring case.
    pub(crate) fn is(&self, keyword: &str) -> bool {
        self.text.eq_ignore_ascii_case(keyword)
    }

    /// Whether the word begins with a digit.
    pub(crate) fn begins_with_digit(&self) -> bool {
        self.text.as_bytes().first().is_some_and(u8::is_ascii_digit)
    }

    /// The value of this keyword in `table`.
    pub(crate) fn lookup<T: Copy>(&self, table: &[(&'static str, T)]) -> Option<T> {
        let place = self.place(&|at| table.get(at).map(|&(keyword, _)| keyword))?;
        table.get(place).map(|&(_, value)| value)
    }

    /// The value of this keyword in `table`; the error reports what was `expected` and the nearest keyword.
    pub(crate) fn keyword<T: Copy>(
        &self,
        table: &[(&'static str, T)],
        expected: &'static str,
    ) -> Result<T, Wrong> {
        self.lookup(table)
            .ok_or_else(|| self.unknown(&|at| table.get(at).map(|&(keyword, _)| keyword), &[], expected))
    }

    // Not inlined: each table would have a loop of its own.
    #[inline(never)]
    fn place(&self, keywords: Keywords) -> Option<usize> {
        (0..).map_while(keywords).position(|keyword| self.is(keyword))
    }

    /// The error that this is none of the keywords, with the nearest one, or the equivalent in `elsewhere`.
    pub(crate) fn unknown(
        &self,
        keywords: Keywords,
        elsewhere: &[(&str, &'static str)],
        expected: &'static str,
    ) -> Wrong {
        let near = (0..).map_while(keywords).find(|keyword| is_near(self.text, keyword));
        let other = || elsewhere.iter().find(|(word, _)| self.is(word)).map(|(_, keyword)| *keyword);
        self.error(Problem::Expected { expected, near: near.or_else(other) })
    }

    /// Reports `problem` with this word.
    pub(crate) fn error(&self, problem: Problem) -> Wrong {
        self.wrong.set(Some(LineError::new(self.column, self.text, problem)));
        Wrong
    }

    /// Reports that something else was `expected` here.
    pub(crate) fn expected(&self, expected: &'static str) -> Wrong {
        self.error(Problem::Expected { expected, near: None })
    }
}

/// Parses a line word by word, and stores its error.
pub(crate) struct Words<'a> {
    /// The whole line.
    pub(crate) line: &'a str,
    rest: Cell<&'a str>,
    column: Cell<usize>,
    wrong: Cell<Option<LineError>>,
}

impl<'a> Words<'a> {
    /// Starts at the first word of `line`.
    pub(crate) fn new(line: &'a str) -> Self {
        Self { line, rest: Cell::new(line), column: Cell::new(1), wrong: Cell::new(None) }
    }

    /// The details of the last [`Wrong`].
    pub(crate) fn wrong(&self) -> LineError {
        self.wrong.take().unwrap_or_else(LineError::too_long)
    }

    /// Puts `problem` in place of what is wrong with a word that is one of `known`.
    // Images with all words lack none.
    #[cfg(not(feature = "long-values"))]
    pub(crate) fn explain(&self, known: &[&str], problem: Problem) -> Wrong {
        let mut wrong = self.wrong();
        if known.iter().any(|word| wrong.word.eq_ignore_ascii_case(word)) {
            wrong.problem = problem;
        }
        self.wrong.set(Some(wrong));
        Wrong
    }

    /// The next word, without consuming it.
    pub(crate) fn peek(&self) -> Word<'_> {
        let (rest, column) = (self.rest.get(), self.column.get());
        let word = self.take();
        self.rest.set(rest);
        self.column.set(column);
        word
    }

    /// Consumes the next word.
    pub(crate) fn take(&self) -> Word<'_> {
        let listed = self.advance_to(|byte| !is_separator(byte)).contains(',');
        let column = self.column.get();
        if self.rest.get().starts_with('#') {
            self.rest.set("");
        }
        Word { text: self.advance_to(is_separator), column, listed, wrong: &self.wrong }
    }

    /// Consumes the next word, or everything between quotes, without them.
    pub(crate) fn take_quoted(&self) -> Word<'_> {
        let (rest, column) = (self.rest.get(), self.column.get());
        let word = self.take();
        let quote_at = word.column - column;
        let inside = word.text.starts_with('"').then(|| rest.get(quote_at + 1..)).flatten();
        let Some((text, _)) = inside.and_then(|inside| inside.split_once('"')) else { return word };
        self.rest.set(rest);
        self.column.set(column);
        self.advance(quote_at + 1 + text.len() + 1);
        Word { text, ..word }
    }

    /// Fails unless the line ends here.
    pub(crate) fn end(&self) -> Result<(), Wrong> {
        let word = self.take();
        if word.is_end() { Ok(()) } else { Err(word.expected("the end of the line")) }
    }

    /// What has not been consumed.
    // For interfaces with settings by name.
    #[cfg(feature = "web")]
    pub(crate) fn rest(&self) -> &'a str {
        self.rest.get()
    }

    fn advance_to(&self, is_end: fn(u8) -> bool) -> &'a str {
        let rest = self.rest.get();
        self.advance(rest.bytes().position(is_end).unwrap_or(rest.len()))
    }

    fn advance(&self, bytes: usize) -> &'a str {
        let rest = self.rest.get();
        let (passed, rest) = rest.split_at_checked(bytes).unwrap_or((rest, ""));
        self.rest.set(rest);
        self.column.set(self.column.get() + passed.chars().count());
        passed
    }
}

/// The column of `text` in `line`, or else of the first word, and the word truncated for an error.
pub(crate) fn find_word(line: &str, text: &str) -> (usize, String<WORD_BYTES_MAX>) {
    let words = Words::new(line);
    let mut found = words.peek();
    loop {
        let word = words.take();
        if word.is_end() {
            break;
        }
        if word.is(text) {
            found = word;
            break;
        }
    }
    (found.column, cut(found.text))
}

/// Whether `byte` separates words. ASCII only, so no byte of a longer character matches.
pub(crate) fn is_separator(byte: u8) -> bool {
    byte.is_ascii_whitespace() || byte == b','
}

/// Whether `typed` is `keyword` with one letter wrong, missing or added, or two neighbours swapped.
fn is_near(typed: &str, keyword: &str) -> bool {
    // One or two letters resemble everything.
    if typed.len() < 3 {
        return false;
    }
    let same = |a: &u8, b: &u8| a.eq_ignore_ascii_case(b);
    let (typed, keyword) = (typed.as_bytes(), keyword.as_bytes());
    let front = typed.iter().zip(keyword).take_while(|(a, b)| same(a, b)).count();
    let typed = typed.get(front..).unwrap_or_default();
    let keyword = keyword.get(front..).unwrap_or_default();
    let back = typed.iter().rev().zip(keyword.iter().rev()).take_while(|(a, b)| same(a, b)).count();
    let typed = typed.get(..typed.len() - back).unwrap_or_default();
    let keyword = keyword.get(..keyword.len() - back).unwrap_or_default();
    match (typed, keyword) {
        ([], [_]) | ([_], []) | ([_], [_]) => true,
        ([a, b], [c, d]) => same(a, d) && same(b, c),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blanks_tabs_and_commas_part_words_and_a_comment_ends_the_line() {
        let words = Words::new("  port\tP1,, 9600 # the rest");
        let next = || {
            let word = words.take();
            (word.text, word.column, word.listed)
        };
        assert_eq!(next(), ("port", 3, false));
        assert_eq!(next(), ("P1", 8, false));
        assert_eq!(next(), ("9600", 13, true));
        assert_eq!(next(), ("", 18, false));
        assert_eq!(next(), ("", 18, false));
    }

    #[test]
    fn columns_count_characters_not_bytes() {
        let words = Words::new("größe x");
        assert_eq!(words.take().text, "größe");
        assert_eq!(words.take().column, 7);
    }

    #[test]
    fn a_hash_inside_a_word_belongs_to_the_word() {
        assert_eq!(Words::new("a#b").take().text, "a#b");
    }

    #[test]
    fn one_wrong_letter_is_near_and_two_are_not() {
        for typed in ["timeut", "timeouts", "tineout", "tiemout", "TIMEOT"] {
            assert!(is_near(typed, "timeout"), "{typed}");
        }
        for typed in ["tmeut", "out", "to", "", "retries"] {
            assert!(!is_near(typed, "timeout"), "{typed}");
        }
    }
}
