//! Typed values with their text form: numbers of one to four registers, text, and bits.

use core::fmt;

use super::form::Form;
use super::fraction;
use super::long::{LongType, LongValue, VALUE_LONGEST};

/// The type of a row's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ValueType {
    /// A bit.
    Bit,
    /// A register, unsigned.
    #[default]
    U16,
    /// A register, signed.
    I16,
    /// Two registers, unsigned.
    U32,
    /// Two registers, signed.
    I32,
    /// Two registers, as an IEEE 754 float.
    F32,
    /// Four registers, or text.
    Long(LongType),
}

impl ValueType {
    /// The types of numbers in registers, as EtherCAT numbers them (8nn0h:0E and 0F).
    pub const NUMBERS: &[Self] = &[
        Self::U16,
        Self::I16,
        Self::U32,
        Self::I32,
        Self::F32,
        // As the types.
        #[cfg(feature = "long-values")]
        Self::Long(LongType::U64),
        #[cfg(feature = "long-values")]
        Self::Long(LongType::I64),
        #[cfg(feature = "long-values")]
        Self::Long(LongType::F64),
    ];

    /// Bits per value.
    pub const fn bits(self) -> u16 {
        match self {
            Self::Bit => 1,
            Self::U16 | Self::I16 => 16,
            Self::U32 | Self::I32 | Self::F32 => 32,
            Self::Long(long) => long.bits(),
        }
    }

    /// Registers per value.
    pub const fn registers(self) -> u16 {
        self.bits().div_ceil(16)
    }

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Bit => "bit",
            Self::U16 => "u16",
            Self::I16 => "i16",
            Self::U32 => "u32",
            Self::I32 => "i32",
            Self::F32 => "f32",
            Self::Long(long) => long.name(),
        }
    }

    /// Its number among all types.
    pub(crate) const fn number(self) -> u8 {
        match self {
            Self::Bit => 0,
            Self::U16 => 1,
            Self::I16 => 2,
            Self::U32 => 3,
            Self::I32 => 4,
            Self::F32 => 5,
            Self::Long(long) => long.number(),
        }
    }

    /// Whether its values are text.
    pub const fn is_text(self) -> bool {
        match self {
            Self::Long(long) => long.is_text(),
            _ => false,
        }
    }

    /// Whether its values are whole numbers, and signed.
    // Only scales and publishers ask for it.
    #[cfg(any(feature = "long-values", feature = "mqtt"))]
    pub(super) const fn is_signed(self) -> Option<bool> {
        match self {
            Self::Bit | Self::U16 | Self::U32 => Some(false),
            Self::I16 | Self::I32 => Some(true),
            Self::F32 => None,
            Self::Long(long) => long.is_signed(),
        }
    }

    /// The form of its values in registers.
    #[cfg_attr(not(feature = "long-values"), allow(unreachable_code))] // There is no longer type.
    pub const fn form(self) -> Form {
        match self {
            Self::Bit | Self::U16 | Self::I16 => Form::Cells,
            Self::U32 | Self::I32 | Self::F32 => Form::Wide,
            Self::Long(long) => Form::Long(long.form()),
        }
    }

    /// The value in the first bytes of `registers`; a bit is the lowest.
    pub fn take(self, registers: &[u8]) -> Option<TypedValue<'_>> {
        let short = registers.first_chunk().map(|bytes| u16::from_be_bytes(*bytes));
        let long = registers.first_chunk().map(|bytes| u32::from_be_bytes(*bytes));
        Some(match self {
            Self::Bit => TypedValue::Whole((registers.first()? & 1).into()),
            Self::U16 => TypedValue::Whole(short?.into()),
            Self::I16 => TypedValue::Whole(short?.cast_signed().into()),
            Self::U32 => TypedValue::Whole(long?.into()),
            Self::I32 => TypedValue::Whole(long?.cast_signed().into()),
            Self::F32 => TypedValue::Fraction(f32::from_bits(long?)),
            Self::Long(long) => TypedValue::Long(long.take(registers)?),
        })
    }

    /// Parses `text` into the first registers of the result; hexadecimal after `0x`.
    pub fn parse(self, text: &str) -> Option<[u8; VALUE_LONGEST]> {
        let short = match self {
            Self::Long(long) => return long.parse(text),
            Self::F32 => fraction::parse(text).map(|value| value.to_bits().to_be_bytes()),
            _ => self.parse_whole(text),
        }?;
        let mut bytes = [0; VALUE_LONGEST];
        bytes.iter_mut().zip(short).for_each(|(place, byte)| *place = byte);
        Some(bytes)
    }

    fn parse_whole(self, text: &str) -> Option<[u8; 4]> {
        let (digits, radix) = match text.strip_prefix("0x") {
            Some(digits) => (digits, 16),
            None => (text.strip_prefix('-').unwrap_or(text), 10),
        };
        let magnitude = i64::from(u32::from_str_radix(digits, radix).ok()?);
        let whole = if text.starts_with('-') { -magnitude } else { magnitude };
        let [a, b] = match self {
            Self::Bit => [u8::try_from(whole).ok().filter(|bit| *bit <= 1)?, 0],
            Self::U16 => u16::try_from(whole).ok()?.to_be_bytes(),
            Self::I16 => i16::try_from(whole).ok()?.to_be_bytes(),
            Self::U32 => return u32::try_from(whole).ok().map(u32::to_be_bytes),
            _ => return i32::try_from(whole).ok().map(i32::to_be_bytes),
        };
        Some([a, b, 0, 0])
    }
}

/// The name, of a text with its registers: `text 8`.
impl fmt::Display for ValueType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Long(long) => long.fmt(f),
            _ => f.write_str(self.name()),
        }
    }
}

/// A value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TypedValue<'r> {
    /// An integer.
    Whole(i64),
    /// A float.
    Fraction(f32),
    /// A longer one, or one with a scale.
    Long(LongValue<'r>),
}

impl TypedValue<'_> {
    /// Writes it as JSON: a number, a string, or `null` for what JSON has no number for.
    #[cfg(any(feature = "web", feature = "mqtt"))] // Others have no JSON.
    pub(crate) fn write_json(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Long(value) => value.write_json(f),
            Self::Fraction(value) if !value.is_finite() => f.write_str("null"),
            Self::Whole(_) | Self::Fraction(_) => fmt::Display::fmt(self, f),
        }
    }
}

impl fmt::Display for TypedValue<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole(value) => value.fmt(f),
            Self::Fraction(value) => fraction::write(*value, f),
            Self::Long(value) => value.fmt(f),
        }
    }
}
