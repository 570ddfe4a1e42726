//! Words of longer types, bits of a register, scales and periodic writes.

use core::ops::RangeInclusive;

use super::listed::{joined, listed};
use super::point_problem::PointProblem;
use super::problem::Problem;
use super::values::{PERIOD, parse_number, small, whole_ms};
use super::words::{Word, Words, Wrong};
use crate::scanner::{
    Decimal, LongType, Period, RegisterBits, Scale, TEXT_REGISTERS_MAX, ValueType, Writing,
};

/// Types of numbers in registers.
pub(crate) const TYPES: &[(&str, ValueType)] = &[
    ("u16", ValueType::U16),
    ("i16", ValueType::I16),
    ("u32", ValueType::U32),
    ("i32", ValueType::I32),
    ("f32", ValueType::F32),
    ("u64", ValueType::Long(LongType::U64)),
    ("i64", ValueType::Long(LongType::I64)),
    ("f64", ValueType::Long(LongType::F64)),
];

const TYPES_EXPECTED: &str = listed!(TYPES);
const TYPES_AND_TEXT: &str = joined!(&[TYPES_EXPECTED, ", or text and its registers"]);
const TEXT_REGISTERS: RangeInclusive<u8> = 1..=TEXT_REGISTERS_MAX;

pub(super) const WRITING_EXPECTED: &str = "auto, change, manual, or every and a period";

/// Keywords of values that no table has.
pub(super) const VALUE_KEYWORDS: &[&str] = &["text", "every"];

/// `u16`, or where it `may_be_text` also `text 8`.
pub(crate) fn value_type(words: &Words, may_be_text: bool) -> Result<ValueType, Wrong> {
    let word = words.take();
    if !may_be_text {
        return word.keyword(TYPES, TYPES_EXPECTED);
    }
    if !word.is("text") {
        return word.keyword(TYPES, TYPES_AND_TEXT);
    }
    let registers = small(words.take(), "registers of two characters", TEXT_REGISTERS)?;
    Ok(ValueType::Long(LongType::Text(registers)))
}

/// `4-7`
pub(super) fn bits(words: &Words) -> Result<RegisterBits, Wrong> {
    let word = words.take();
    let bit = |text| parse_number(text).and_then(|nth| u8::try_from(nth).ok());
    let ends = word.text.split_once('-').and_then(|(first, last)| Some((bit(first)?, bit(last)?)));
    let bits = ends.and_then(|(first, last)| RegisterBits::several(first, last));
    bits.ok_or_else(|| word.expected("bits of the register from 0 to 15, such as 4-7"))
}

/// The scale with another factor or, if it is not that, another offset.
pub(super) fn scale(scale: Scale, is_factor: bool, words: &Words) -> Result<Scale, Wrong> {
    let word = words.take();
    let number = Decimal::parse(word.text);
    match is_factor {
        true => number
            .and_then(|factor| scale.with_factor(factor))
            .ok_or_else(|| word.expected("a number other than 0 of at most nine digits, such as 0.1")),
        false => number
            .and_then(|offset| scale.with_offset(offset))
            .ok_or_else(|| word.expected("a number of at most nine digits, such as -40")),
    }
}

/// Whether only numbers have what `word` says.
pub(super) fn check_scale(scale: Scale, value: ValueType, word: Word) -> Result<(), Wrong> {
    let is_number = value != ValueType::Bit && !value.is_text();
    match is_number || scale.is_none() {
        true => Ok(()),
        false => Err(word.error(Problem::Points(PointProblem::NotANumber))),
    }
}

/// `30s`, after `every`.
pub(super) fn every(word: Word, words: &Words) -> Option<Result<Writing, Wrong>> {
    let period = || whole_ms(words.take(), &PERIOD).map(|ms| Writing::Every(Period(ms)));
    word.is("every").then(period)
}

/// The error of a line.
pub(super) fn lacking(_: &Words) -> Wrong {
    Wrong
}
