//! Scale and offset of a point: a value is its raw number times the scale plus the offset, in decimal numbers, so that 235 tenths are
//! 23.5. Values of bit fields have the range of so many bits.

use core::fmt;

use super::decimal::Decimal;
use super::long::{LongType, LongValue, VALUE_LONGEST};
use super::typed::{TypedValue, ValueType};

/// Most digits of a scale or an offset, and of those behind the point.
const DIGITS: core::ops::RangeInclusive<i32> = -999_999_999..=999_999_999;
const DECIMALS_MAX: u8 = 9;

/// How raw numbers are shown and written.
// Mantissa and decimals apart: there are many points, and this is half as long.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Scale {
    factor: i32,
    offset: i32,
    factor_decimals: u8,
    offset_decimals: u8,
}

/// Why a text is no value of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unfit {
    /// It is none of its type.
    NoValue,
    /// Its raw number is out of range.
    Beyond(ValueRange),
}

/// The values for raw numbers of some bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ValueRange {
    scale: Scale,
    bits: u16,
    is_signed: bool,
}

impl ValueRange {
    /// The least and the greatest raw number.
    fn raw(self) -> (i128, i128) {
        let above = 1_i128 << if self.is_signed { self.bits - 1 } else { self.bits };
        (if self.is_signed { -above } else { 0 }, above - 1)
    }
}

impl ValueRange {
    /// The least and the greatest value.
    fn ends(self) -> (Decimal, Decimal) {
        let (least, greatest) = self.raw();
        let (low, high) = if self.scale.factor < 0 { (greatest, least) } else { (least, greatest) };
        (self.scale.whole(low), self.scale.whole(high))
    }
}

impl fmt::Display for ValueRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (low, high) = self.ends();
        write!(f, "{low} to {high}")
    }
}

impl Scale {
    /// Values are raw numbers.
    pub const NONE: Self = Self { factor: 1, offset: 0, factor_decimals: 0, offset_decimals: 0 };

    /// Whether values are raw numbers.
    pub fn is_none(self) -> bool {
        self == Self::NONE
    }

    /// The factor.
    pub fn factor(self) -> Decimal {
        Decimal::new(self.factor.into(), self.factor_decimals)
    }

    /// What is added.
    pub fn offset(self) -> Decimal {
        Decimal::new(self.offset.into(), self.offset_decimals)
    }

    /// With another factor; `None` if it is 0, or has more than nine digits.
    pub fn with_factor(self, factor: Decimal) -> Option<Self> {
        let (factor, factor_decimals) = settable(factor).filter(|(factor, _)| *factor != 0)?;
        Some(Self { factor, factor_decimals, ..self })
    }

    /// With another offset; `None` if it has more than nine digits.
    pub fn with_offset(self, offset: Decimal) -> Option<Self> {
        let (offset, offset_decimals) = settable(offset)?;
        Some(Self { offset, offset_decimals, ..self })
    }

    /// Writes the words that set it, each after a blank.
    pub(crate) fn write(self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.factor() != Self::NONE.factor() {
            write!(f, " scale {}", self.factor())?;
        }
        if self.offset() != Self::NONE.offset() {
            write!(f, " offset {}", self.offset())?;
        }
        Ok(())
    }

    /// The value for the raw one.
    pub fn apply(self, raw: TypedValue<'_>) -> TypedValue<'_> {
        match raw {
            _ if self.is_none() => raw,
            TypedValue::Whole(raw) => self.scaled(raw.into()),
            TypedValue::Long(LongValue::U64(raw)) => self.scaled(raw.into()),
            TypedValue::Long(LongValue::I64(raw)) => self.scaled(raw.into()),
            TypedValue::Fraction(raw) => TypedValue::Fraction(self.float(raw.into()) as f32),
            TypedValue::Long(LongValue::F64(raw)) => TypedValue::Long(LongValue::F64(self.float(raw))),
            TypedValue::Long(LongValue::Text(_) | LongValue::Scaled(_)) => raw,
        }
    }

    /// The least and the greatest value whose raw number has so many `bits`, and the distance between values, or a thousandth if that
    /// is more; `None` for floats and text.
    // Only publishers tell others.
    #[cfg(feature = "mqtt")]
    pub(crate) fn limits(self, value: ValueType, bits: u16) -> Option<[TypedValue<'static>; 3]> {
        let (low, high) = ValueRange { scale: self, bits, is_signed: value.is_signed()? }.ends();
        let step = Decimal::new(i128::from(self.factor).abs(), self.factor_decimals);
        let step = if step.binary() < 0.001 { Decimal::new(1, 3) } else { step };
        Some([low, high, step].map(|number| TypedValue::Long(LongValue::Scaled(number))))
    }

    fn scaled(self, raw: i128) -> TypedValue<'static> {
        TypedValue::Long(LongValue::Scaled(self.whole(raw)))
    }

    /// Has less than 38 digits: raw numbers have 20 at most, the factor nine, and those behind the point are nine.
    fn whole(self, raw: i128) -> Decimal {
        let raw = Decimal::whole(raw);
        raw.times(self.factor()).and_then(|scaled| scaled.plus(self.offset())).unwrap_or(raw)
    }

    fn float(self, raw: f64) -> f64 {
        // Tenths are divided by ten: no binary number is a tenth.
        raw * f64::from(self.factor) / Decimal::power(self.factor_decimals) + self.offset().binary()
    }

    /// Parses a value into the first registers of the result; its raw number has so many `bits`.
    pub fn parse(self, value: ValueType, bits: u16, text: &str) -> Result<[u8; VALUE_LONGEST], Unfit> {
        if self.is_none() && bits == value.bits() {
            return value.parse(text).ok_or(Unfit::NoValue);
        }
        match value.is_signed() {
            Some(is_signed) => self.parse_whole((value.registers(), bits, is_signed), text),
            None => self.parse_float(value, text).ok_or(Unfit::NoValue),
        }
    }

    fn parse_whole(
        self,
        (registers, bits, is_signed): (u16, u16, bool),
        text: &str,
    ) -> Result<[u8; VALUE_LONGEST], Unfit> {
        let hexadecimal = || {
            let digits = text.strip_prefix("0x").filter(|_| self.is_none())?;
            u64::from_str_radix(digits, 16).ok().map(|raw| Decimal::whole(raw.into()))
        };
        let typed = Decimal::parse(text).or_else(hexadecimal).ok_or(Unfit::NoValue)?;
        let range = ValueRange { scale: self, bits, is_signed };
        let (low, high) = range.raw();
        let raw = typed.plus(self.offset().negated()).and_then(|rest| rest.divided(self.factor()));
        let raw = raw.filter(|raw| (low..=high).contains(raw)).ok_or(Unfit::Beyond(range))?;
        let mut bytes = [0; VALUE_LONGEST];
        let raw = raw.to_be_bytes();
        let own = raw.get(raw.len() - 2 * usize::from(registers)..).unwrap_or_default();
        bytes.iter_mut().zip(own).for_each(|(place, byte)| *place = *byte);
        Ok(bytes)
    }

    fn parse_float(self, value: ValueType, text: &str) -> Option<[u8; VALUE_LONGEST]> {
        let typed = text.parse::<f64>().ok()?;
        let raw = (typed - self.offset().binary()) / self.factor().binary();
        let mut bytes = [0; VALUE_LONGEST];
        let (fits, raw) = match value {
            ValueType::Long(LongType::F64) => (raw.is_finite(), raw.to_bits()),
            _ => ((raw as f32).is_finite(), u64::from((raw as f32).to_bits()) << 32),
        };
        bytes.iter_mut().zip(raw.to_be_bytes()).for_each(|(place, byte)| *place = byte);
        (fits || !typed.is_finite()).then_some(bytes)
    }
}

fn settable(number: Decimal) -> Option<(i32, u8)> {
    number.short().filter(|(mantissa, decimals)| DIGITS.contains(mantissa) && *decimals <= DECIMALS_MAX)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::format;
    use std::string::{String, ToString};

    use proptest::prelude::*;

    use super::*;

    const U64: ValueType = ValueType::Long(LongType::U64);
    const F64: ValueType = ValueType::Long(LongType::F64);

    fn scale(factor: &str, offset: &str) -> Scale {
        let [factor, offset] = [factor, offset].map(|text| Decimal::parse(text).unwrap());
        Scale::NONE.with_factor(factor).unwrap().with_offset(offset).unwrap()
    }

    fn shown(scale: Scale, value: ValueType, raw: &[u8]) -> String {
        scale.apply(value.take(raw).unwrap()).to_string()
    }

    #[test]
    fn values_are_exact_in_decimal_digits() {
        for (factor, offset, value, raw, text) in [
            ("0.1", "0", ValueType::U16, &[0, 3][..], "0.3"),
            ("0.1", "-40", ValueType::I16, &[0x02, 0x67], "21.5"),
            ("0.1", "-40", ValueType::I16, &[0x80, 0], "-3316.8"),
            ("1", "0.5", ValueType::U16, &[0, 0], "0.5"),
            ("-1", "0", ValueType::U32, &[0, 0, 0, 7], "-7"),
            ("0.001", "0", U64, &[0xff; 8], "18446744073709551.615"),
            ("999999999", "0.000000001", U64, &[0xff; 8], "18446744055262807541290448385.000000001"),
            ("0.1", "0", ValueType::F32, &[0x41, 0xac, 0, 0], "2.15"),
            ("0.1", "0", F64, &[0x40, 0x08, 0, 0, 0, 0, 0, 0], "0.3"),
            ("2", "1", F64, &[0x3f, 0xf8, 0, 0, 0, 0, 0, 0], "4"),
        ] {
            assert_eq!(shown(scale(factor, offset), value, raw), text, "{factor} {offset} {raw:x?}");
        }
    }

    #[test]
    fn what_cannot_be_a_scale_is_refused() {
        let number = |text| Decimal::parse(text).unwrap();
        for factor in ["0", "0.0", "1000000000", "0.0000000001", "12345.67891"] {
            assert_eq!(Scale::NONE.with_factor(number(factor)), None, "{factor}");
        }
        assert_eq!(Scale::NONE.with_offset(number("-1000000000")), None);
        assert!(scale("1.0", "0").is_none());
    }

    #[test]
    fn values_out_of_range_name_the_ends_and_floats_have_none() {
        let parse = |scale: Scale, value: ValueType, bits, text| match scale.parse(value, bits, text) {
            Ok(_) => "fits".to_string(),
            Err(Unfit::NoValue) => "no value".to_string(),
            Err(Unfit::Beyond(range)) => range.to_string(),
        };
        assert_eq!(parse(scale("-0.5", "0"), ValueType::U16, 16, "0.3"), "-32767.5 to 0");
        assert_eq!(parse(Scale::NONE, ValueType::U16, 4, "16"), "0 to 15");
        assert_eq!(parse(Scale::NONE, ValueType::U16, 4, "0x10"), "0 to 15");
        assert_eq!(parse(Scale::NONE, ValueType::U16, 4, "0xf"), "fits");
        assert_eq!(parse(scale("0.1", "0"), ValueType::U16, 16, "0x1"), "no value");
        let huge = "9".repeat(38);
        assert_eq!(parse(scale("0.1", "0"), ValueType::I16, 16, &huge), "-3276.8 to 3276.7");
        assert_eq!(parse(scale("0.1", "0"), ValueType::F32, 32, "1e38"), "no value");
        assert_eq!(parse(scale("0.1", "0"), ValueType::F32, 32, "inf"), "fits");
        assert_eq!(parse(scale("0.1", "0"), F64, 64, "warm"), "no value");
    }

    proptest! {
        /// Hundredths as whole numbers say what is right.
        #[test]
        fn any_raw_number_is_shown_in_hundredths_and_written_back(raw: i32, factor in -100_000..100_000_i64, offset in -100_000..100_000_i64) {
            prop_assume!(factor != 0);
            let hundredths = |number: i64| {
                let sign = if number < 0 { "-" } else { "" };
                let text = format!("{sign}{}.{:02}", number.abs() / 100, number.abs() % 100);
                String::from(text.trim_end_matches('0').trim_end_matches('.'))
            };
            let scale = scale(&hundredths(factor), &hundredths(offset));
            let text = shown(scale, ValueType::I32, &raw.to_be_bytes());
            prop_assert_eq!(&text, &hundredths(i64::from(raw) * factor + offset));
            let parsed = scale.parse(ValueType::I32, 32, &text).unwrap();
            prop_assert_eq!(&parsed[..4], &raw.to_be_bytes()[..]);
        }

        #[test]
        fn a_float_is_written_as_near_as_a_double_is(value in -1.0e6..1.0e6_f64) {
            let parsed = scale("0.25", "3").parse(F64, 64, &value.to_string()).unwrap();
            let raw = f64::from_be_bytes(parsed[..8].try_into().unwrap());
            prop_assert!((raw / 4.0 + 3.0 - value).abs() <= value.abs() * 1e-15 + 1e-9);
        }
    }
}
