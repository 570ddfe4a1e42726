//! Stands in for words of longer types and so on in images without `long-values`: they are refused, and the error says so.

use super::listed::listed;
use super::problem::Problem;
use super::words::{Word, Words, Wrong};
use crate::scanner::{RegisterBits, Scale, ValueType, Writing};

/// Types of numbers in registers.
pub(crate) const TYPES: &[(&str, ValueType)] = &[
    ("u16", ValueType::U16),
    ("i16", ValueType::I16),
    ("u32", ValueType::U32),
    ("i32", ValueType::I32),
    ("f32", ValueType::F32),
];

const TYPES_EXPECTED: &str = listed!(TYPES);

pub(super) const WRITING_EXPECTED: &str = "auto, change or manual";

pub(super) const VALUE_KEYWORDS: &[&str] = &[];

/// What an image with `long-values` has.
const LACKING: [&str; 8] = ["u64", "i64", "f64", "text", "bits", "scale", "offset", "every"];

pub(crate) fn value_type(words: &Words, _: bool) -> Result<ValueType, Wrong> {
    words.take().keyword(TYPES, TYPES_EXPECTED)
}

/// Never called: the keyword is refused.
pub(super) fn bits(_: &Words) -> Result<RegisterBits, Wrong> {
    Err(Wrong)
}

/// Never called: the keyword is refused.
pub(super) fn scale(scale: Scale, _: bool, _: &Words) -> Result<Scale, Wrong> {
    Ok(scale)
}

pub(super) fn check_scale(_: Scale, _: ValueType, _: Word) -> Result<(), Wrong> {
    Ok(())
}

pub(super) fn every(_: Word, _: &Words) -> Option<Result<Writing, Wrong>> {
    None
}

/// The error of a line, which tells words that only this image lacks.
pub(super) fn lacking(words: &Words) -> Wrong {
    words.explain(&LACKING, Problem::NoLongValues)
}
