//! The types that images without `long-values` lack: numbers of four registers, and text.

use core::fmt::{self, Display};

use super::byte_order::ByteOrder;
use super::decimal::Decimal;
use super::text::{TEXT_BYTES_MAX, Text, padded};

/// Whether the image has these types, scales, bit fields and periodic writes: the feature `long-values`. Code that depends on this
/// constant is left out without it.
pub const LONG_VALUES: bool = true;

/// Bytes of the longest value: text in all registers of a frame.
pub(crate) const VALUE_LONGEST: usize = TEXT_BYTES_MAX;

/// A longer type of values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LongType {
    /// Four registers, unsigned.
    U64,
    /// Four registers, signed.
    I64,
    /// Four registers, as an IEEE 754 float.
    F64,
    /// So many registers, with two characters each.
    Text(u8),
}

impl LongType {
    /// Bits per value.
    pub const fn bits(self) -> u16 {
        match self {
            Self::U64 | Self::I64 | Self::F64 => 64,
            Self::Text(registers) => 16 * registers as u16,
        }
    }

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::U64 => "u64",
            Self::I64 => "i64",
            Self::F64 => "f64",
            Self::Text(_) => "text",
        }
    }

    /// Its name in IEC 61131-3.
    pub const fn iec(self) -> &'static str {
        match self {
            Self::U64 => "ULINT",
            Self::I64 => "LINT",
            Self::F64 => "LREAL",
            Self::Text(_) => "STRING",
        }
    }

    /// Its number among all types.
    pub(super) const fn number(self) -> u8 {
        match self {
            Self::U64 => 6,
            Self::I64 => 7,
            Self::F64 => 8,
            Self::Text(_) => 9,
        }
    }

    /// Whether its values are whole numbers, and signed.
    pub(super) const fn is_signed(self) -> Option<bool> {
        match self {
            Self::U64 => Some(false),
            Self::I64 => Some(true),
            Self::F64 | Self::Text(_) => None,
        }
    }

    /// Whether its values are text.
    pub const fn is_text(self) -> bool {
        matches!(self, Self::Text(_))
    }

    /// The form of its values in registers.
    pub(super) const fn form(self) -> LongForm {
        match self {
            Self::U64 | Self::I64 | Self::F64 => LongForm::Quad,
            Self::Text(_) => LongForm::Text,
        }
    }

    /// The form of its values in bits.
    pub const fn form_of_bits(self) -> LongForm {
        LongForm::Bits
    }

    /// The value in the first bytes of `registers`.
    pub(super) fn take(self, registers: &[u8]) -> Option<LongValue<'_>> {
        let quad = registers.first_chunk().map(|bytes| u64::from_be_bytes(*bytes));
        Some(match self {
            Self::U64 => LongValue::U64(quad?),
            Self::I64 => LongValue::I64(quad?.cast_signed()),
            Self::F64 => LongValue::F64(f64::from_bits(quad?)),
            Self::Text(count) => LongValue::Text(Text::new(registers.get(..2 * usize::from(count))?)),
        })
    }

    /// Parses `text` into the first registers of the result.
    pub(super) fn parse(self, text: &str) -> Option<[u8; VALUE_LONGEST]> {
        let hexadecimal = |digits: &str| u64::from_str_radix(digits, 16).ok();
        let quad = match self {
            Self::F64 => text.parse::<f64>().ok()?.to_bits(),
            Self::Text(registers) => return padded(text, registers),
            Self::U64 | Self::I64 if text.contains('+') => return None,
            Self::U64 => match text.strip_prefix("0x") {
                Some(digits) => hexadecimal(digits)?,
                None => text.parse().ok()?,
            },
            Self::I64 => match text.strip_prefix("0x") {
                Some(digits) => i64::try_from(hexadecimal(digits)?).ok()?.cast_unsigned(),
                None => text.parse::<i64>().ok()?.cast_unsigned(),
            },
        };
        let mut bytes = [0; VALUE_LONGEST];
        bytes.iter_mut().zip(quad.to_be_bytes()).for_each(|(place, byte)| *place = byte);
        Some(bytes)
    }
}

impl Display for LongType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())?;
        match self {
            Self::Text(registers) => write!(f, " {registers}"),
            Self::U64 | Self::I64 | Self::F64 => Ok(()),
        }
    }
}

/// How cells are a longer value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LongForm {
    /// Four registers are a 64-bit value, in the device's byte order.
    Quad,
    /// Registers are text; the device's byte order says which character of a register is first.
    Text,
    /// Sixty-four bits are a number, lowest bit first.
    Bits,
}

impl LongForm {
    /// Whether the cells are bits.
    pub(super) const fn is_of_bits(self) -> bool {
        matches!(self, Self::Bits)
    }

    /// Cells of a value that frames must not part, less one.
    pub(super) const fn rest(self) -> u16 {
        if let Self::Quad = self { 3 } else { 0 }
    }

    /// Converts values from their order in frames, or back: each form is its own inverse.
    pub(super) fn turn(self, order: ByteOrder, values: &mut [u8]) {
        if let Self::Bits = self {
            return values.chunks_exact_mut(8).for_each(<[u8]>::reverse);
        }
        if let ByteOrder::Order1032 | ByteOrder::Order3210 = order {
            values.as_chunks_mut::<2>().0.iter_mut().for_each(|word| word.reverse());
        }
        if let (Self::Quad, ByteOrder::Order2301 | ByteOrder::Order3210) = (self, order) {
            for value in values.as_chunks_mut::<8>().0 {
                let [a, b, c, d, e, f, g, h] = *value;
                *value = [g, h, e, f, c, d, a, b];
            }
        }
    }
}

/// A longer value, or one with a scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LongValue<'r> {
    /// An unsigned number.
    U64(u64),
    /// A signed number.
    I64(i64),
    /// A float.
    F64(f64),
    /// Text.
    Text(Text<'r>),
    /// A number with a scale.
    Scaled(Decimal),
}

impl LongValue<'_> {
    /// Writes it as JSON: text as a string, and numbers of more digits than readers keep as strings of their digits.
    // As what asks for it.
    #[cfg(any(feature = "web", feature = "mqtt"))]
    pub(crate) fn write_json(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let keeps = |magnitude: u64| magnitude <= 1 << 53;
        let is_number = match self {
            Self::U64(value) => keeps(*value),
            Self::I64(value) => keeps(value.unsigned_abs()),
            Self::F64(value) if !value.is_finite() => return f.write_str("null"),
            Self::F64(_) => true,
            Self::Scaled(value) => value.is_short(),
            Self::Text(text) => return write!(f, "\"{text:#}\""),
        };
        if is_number { write!(f, "{self}") } else { write!(f, "\"{self}\"") }
    }
}

impl Display for LongValue<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::U64(value) => value.fmt(f),
            Self::I64(value) => value.fmt(f),
            // Hundreds of digits tell people nothing.
            Self::F64(value) if is_extreme(*value) => write!(f, "{value:e}"),
            Self::F64(value) => value.fmt(f),
            Self::Text(text) => write!(f, "\"{text}\""),
            Self::Scaled(value) => value.fmt(f),
        }
    }
}

/// Whether a number has more than 21 digits, or more than six zeros behind the point.
fn is_extreme(value: f64) -> bool {
    let magnitude = value.abs();
    magnitude.is_finite() && magnitude > 0.0 && !(1e-6..1e21).contains(&magnitude)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString;
    use std::vec::Vec;

    use proptest::prelude::*;

    use super::*;

    const ORDERS: [ByteOrder; 4] =
        [ByteOrder::Order0123, ByteOrder::Order2301, ByteOrder::Order1032, ByteOrder::Order3210];

    #[test]
    fn four_registers_come_in_the_order_of_two() {
        // 0123456789ABCDEFh as devices of each order send it.
        for (order, wire) in [
            (ByteOrder::Order0123, "01 23 45 67 89 AB CD EF"),
            (ByteOrder::Order2301, "CD EF 89 AB 45 67 01 23"),
            (ByteOrder::Order1032, "23 01 67 45 AB 89 EF CD"),
            (ByteOrder::Order3210, "EF CD AB 89 67 45 23 01"),
        ] {
            let mut bytes: Vec<u8> =
                wire.split(' ').map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect();
            LongForm::Quad.turn(order, &mut bytes);
            let value = LongType::U64.take(&bytes).unwrap().to_string();
            assert_eq!(value, "81985529216486895", "{order:?}");
        }
    }

    #[test]
    fn text_has_its_characters_in_the_order_of_bytes_and_never_of_words() {
        for (order, wire) in [
            (ByteOrder::Order0123, b"Pump 7\0\0"),
            (ByteOrder::Order2301, b"Pump 7\0\0"),
            (ByteOrder::Order1032, b"uPpm7 \0\0"),
            (ByteOrder::Order3210, b"uPpm7 \0\0"),
        ] {
            let mut bytes = *wire;
            LongForm::Text.turn(order, &mut bytes);
            assert_eq!(LongType::Text(4).take(&bytes).unwrap().to_string(), "\"Pump 7\"", "{order:?}");
        }
    }

    #[test]
    fn sixty_four_bits_have_the_lowest_first() {
        let mut bits = [0x01, 0, 0, 0, 0, 0, 0, 0x80];
        LongForm::Bits.turn(ByteOrder::Order3210, &mut bits);
        assert_eq!(LongType::U64.take(&bits), Some(LongValue::U64(0x8000_0000_0000_0001)));
    }

    #[test]
    fn each_type_has_a_number_of_its_own() {
        use crate::scanner::ValueType::{Bit, F32, I16, I32, Long, U16, U32};
        let long = [LongType::U64, LongType::I64, LongType::F64, LongType::Text(2)].map(Long);
        let types = [Bit, U16, I16, U32, I32, F32].into_iter().chain(long);
        assert!(types.map(|value_type| value_type.number()).eq(0..10));
    }

    #[test]
    fn numbers_at_the_ends_of_their_range_are_read_and_beyond_refused() {
        for (kind, text, bytes) in [
            (LongType::U64, "18446744073709551615", Some([0xff; 8])),
            (LongType::U64, "18446744073709551616", None),
            (LongType::U64, "-1", None),
            (LongType::U64, "+1", None),
            (LongType::U64, "0xFFFFFFFFFFFFFFFE", Some([0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xfe])),
            (LongType::U64, "0x+1", None),
            (LongType::I64, "-9223372036854775808", Some([0x80, 0, 0, 0, 0, 0, 0, 0])),
            (LongType::I64, "9223372036854775808", None),
            (LongType::I64, "-2", Some([0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xfe])),
            (LongType::I64, "0x8000000000000000", None),
            // -230.1 = -8.9d 00110..h times 2 to the power of 7.
            (LongType::F64, "-230.125", Some([0xc0, 0x6c, 0xc4, 0, 0, 0, 0, 0])),
            (LongType::F64, "1.5e-284", Some([0x05, 0x01, 0xd8, 0x1d, 0xae, 0x6e, 0x22, 0x1c])),
            (LongType::F64, "1.5", Some([0x3f, 0xf8, 0, 0, 0, 0, 0, 0])),
            (LongType::F64, "1,5", None),
        ] {
            let read = kind.parse(text).map(|bytes| <[u8; 8]>::try_from(&bytes[..8]).unwrap());
            assert_eq!(read, bytes, "{kind} {text}");
            if let (Some(bytes), false) = (bytes, text.starts_with("0x")) {
                assert_eq!(kind.take(&bytes).map(|value| value.to_string()).as_deref(), Some(text));
                assert_eq!(kind.take(&bytes[..7]), None);
            }
        }
    }

    #[test]
    fn what_is_not_printable_in_a_text_is_shown_escaped_and_read_so() {
        let shown = |bytes: &[u8]| LongType::Text(3).take(bytes).unwrap().to_string();
        assert_eq!(shown(b"ab  \0\0"), "\"ab\"");
        assert_eq!(shown(b"a \0 b\0"), "\"a \\x00 b\"");
        assert_eq!(shown(b"\x1b[2J\xe9\""), "\"\\x1b[2J\\xe9\\x22\"");
        assert_eq!(shown(b"\0\0\0\0\0\0"), "\"\"");
        assert_eq!(std::format!("{:#}", Text::new(b"a\\")), "a\\\\x5c", "in JSON a backslash is two");
        let read = |text| LongType::Text(3).parse(text).map(|bytes| bytes[..8].to_vec());
        assert_eq!(read("ab").as_deref(), Some(&b"ab\0\0\0\0\0\0"[..]));
        assert_eq!(read("\\x1b[2J\\xe9").as_deref(), Some(&b"\x1b[2J\xe9\0\0\0"[..]));
        for bad in ["seven c", "a\\", "\\x1", "\\xg0", "\\n", "ääää"] {
            assert_eq!(read(bad), None, "{bad}");
        }
    }

    proptest! {
        #[test]
        fn each_order_is_its_own_inverse(bytes in prop::collection::vec(any::<u8>(), 0..5), nth in 0..4_usize) {
            let original = bytes.repeat(8);
            for form in [LongForm::Quad, LongForm::Text, LongForm::Bits] {
                let mut turned = original.clone();
                form.turn(ORDERS[nth], &mut turned);
                form.turn(ORDERS[nth], &mut turned);
                prop_assert_eq!(&turned, &original);
            }
        }

        #[test]
        fn any_number_is_shown_and_read_as_the_standard_library_does(bytes in any::<[u8; 8]>()) {
            let shown = |kind: LongType| kind.take(&bytes).unwrap().to_string();
            prop_assert_eq!(shown(LongType::U64), u64::from_be_bytes(bytes).to_string());
            prop_assert_eq!(shown(LongType::I64), i64::from_be_bytes(bytes).to_string());
            let (float, read) = (f64::from_be_bytes(bytes), shown(LongType::F64).parse::<f64>().unwrap());
            prop_assert!(read.to_bits() == float.to_bits() || read.is_nan() && float.is_nan());
            prop_assert!(shown(LongType::F64).len() <= 25);
            for kind in [LongType::U64, LongType::I64] {
                prop_assert_eq!(&kind.parse(&shown(kind)).unwrap()[..8], &bytes[..]);
            }
        }

        #[test]
        fn any_text_is_read_as_it_is_shown(bytes in prop::collection::vec(any::<u8>(), 20)) {
            let shown = LongType::Text(10).take(&bytes).unwrap().to_string();
            let mut end = bytes.len();
            while end > 0 && [0, b' '].contains(&bytes[end - 1]) {
                end -= 1;
            }
            let mut without_padding = bytes[..end].to_vec();
            without_padding.resize(20, 0);
            let read = LongType::Text(10).parse(shown.trim_matches('"')).unwrap();
            prop_assert_eq!(&read[..20], &without_padding[..]);
        }
    }
}
