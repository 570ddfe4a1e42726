//! Typed values with their text form: 16-bit and 32-bit numbers, and bits.

use core::fmt;

use super::fraction;

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
}

impl ValueType {
    /// Bits per value.
    pub const fn bits(self) -> u16 {
        match self {
            Self::Bit => 1,
            Self::U16 | Self::I16 => 16,
            Self::U32 | Self::I32 | Self::F32 => 32,
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
        }
    }

    /// The value in the first bytes of `registers`; a bit is the lowest.
    pub fn take(self, registers: &[u8]) -> Option<TypedValue> {
        let short = registers.first_chunk().map(|bytes| u16::from_be_bytes(*bytes));
        let long = registers.first_chunk().map(|bytes| u32::from_be_bytes(*bytes));
        Some(match self {
            Self::Bit => TypedValue::Whole((registers.first()? & 1).into()),
            Self::U16 => TypedValue::Whole(short?.into()),
            Self::I16 => TypedValue::Whole(short?.cast_signed().into()),
            Self::U32 => TypedValue::Whole(long?.into()),
            Self::I32 => TypedValue::Whole(long?.cast_signed().into()),
            Self::F32 => TypedValue::Fraction(f32::from_bits(long?)),
        })
    }

    /// Parses `text` into the first registers of the result; hexadecimal after `0x`.
    pub fn parse(self, text: &str) -> Option<[u8; 4]> {
        if self == Self::F32 {
            return fraction::parse(text).map(|value| value.to_bits().to_be_bytes());
        }
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
            Self::I32 | Self::F32 => return i32::try_from(whole).ok().map(i32::to_be_bytes),
        };
        Some([a, b, 0, 0])
    }
}

/// A value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TypedValue {
    /// An integer.
    Whole(i64),
    /// A float.
    Fraction(f32),
}

impl fmt::Display for TypedValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole(value) => value.fmt(f),
            Self::Fraction(value) => fraction::write(*value, f),
        }
    }
}
