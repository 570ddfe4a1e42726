//! Values of data points and of registers, as people and programs see them.

use core::fmt;
use core::ops::Range;

use crate::scanner::{Scale, TypedValue, ValueType};

/// A range of the values in `cells`, each after a blank.
pub(crate) struct Values<'v> {
    pub(crate) value: ValueType,
    pub(crate) scale: Scale,
    /// As in memory: bits from the lowest on, registers with the high byte first.
    pub(crate) cells: &'v [u8],
    pub(crate) range: Range<usize>,
}

impl<'v> Values<'v> {
    /// Value number `nth`.
    pub(crate) fn get(&self, nth: usize) -> Option<TypedValue<'v>> {
        if self.value == ValueType::Bit {
            let bit = self.cells.get(nth / 8).is_some_and(|byte| byte >> (nth % 8) & 1 == 1);
            return Some(TypedValue::Whole(bit.into()));
        }
        let at = 2 * usize::from(self.value.registers()) * nth;
        let raw = self.value.take(self.cells.get(at..).unwrap_or_default())?;
        Some(self.scale.apply(raw))
    }

    /// Writes value number `nth` as JSON; `null` if there is none.
    #[cfg(any(feature = "web", feature = "mqtt"))] // Others have no JSON.
    pub(crate) fn write_json(&self, nth: usize, out: &mut dyn fmt::Write) -> fmt::Result {
        match self.get(nth) {
            Some(value) => write!(out, "{}", fmt::from_fn(|f| value.write_json(f))),
            None => out.write_str("null"),
        }
    }
}

impl fmt::Display for Values<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for nth in self.range.clone() {
            match self.get(nth) {
                Some(value) => write!(f, " {value}")?,
                None => f.write_str(" ?")?,
            }
        }
        Ok(())
    }
}

/// Values as a list of JSON; what JSON has no number for is `null`, and text and numbers of many digits are strings.
#[cfg(any(feature = "web", feature = "mqtt"))] // As above; also below.
pub(crate) struct Numbers<'v>(pub(crate) Values<'v>);

#[cfg(any(feature = "web", feature = "mqtt"))]
impl fmt::Display for Numbers<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("[")?;
        for nth in self.0.range.clone() {
            f.write_str(if nth > 0 { "," } else { "" })?;
            self.0.write_json(nth, f)?;
        }
        f.write_str("]")
    }
}

#[cfg(feature = "mqtt")] // As what writes JSON.
#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::String;

    use super::*;

    fn json(value: ValueType, scale: Scale, cells: &[u8], nth: usize) -> String {
        let mut text = String::new();
        Values { value, scale, cells, range: 0..1 }.write_json(nth, &mut text).unwrap();
        text
    }

    #[test]
    fn values_are_numbers_of_json_or_null() {
        let one = |value, cells: &[u8], nth| json(value, Scale::NONE, cells, nth);
        assert_eq!(one(ValueType::Bit, &[0b10], 1), "1");
        assert_eq!(one(ValueType::I16, &[0, 1, 0xff, 0xfe], 1), "-2");
        assert_eq!(one(ValueType::F32, &21.5_f32.to_be_bytes(), 0), "21.5");
        assert_eq!(one(ValueType::F32, &f32::NAN.to_be_bytes(), 0), "null");
        assert_eq!(one(ValueType::F32, &f32::INFINITY.to_be_bytes(), 0), "null");
        assert_eq!(one(ValueType::U32, &[0, 0], 0), "null");
    }

    #[test]
    #[cfg(feature = "long-values")]
    fn numbers_that_readers_would_round_and_text_are_strings_of_json() {
        use crate::scanner::{Decimal, LongType};
        let one = |long, cells: &[u8]| json(ValueType::Long(long), Scale::NONE, cells, 0);
        assert_eq!(one(LongType::U64, &[0xff; 8]), "\"18446744073709551615\"");
        assert_eq!(one(LongType::I64, &[0xff; 8]), "-1");
        assert_eq!(one(LongType::F64, &f64::NAN.to_be_bytes()), "null");
        assert_eq!(one(LongType::Text(2), b"a\"b\0"), r#""a\\x22b""#);
        let tenths = Scale::NONE.with_factor(Decimal::parse("0.1").unwrap()).unwrap();
        assert_eq!(json(ValueType::U16, tenths, &[0, 235], 0), "23.5");
    }
}
