//! Stands in for scales in images without `long-values`: values are raw numbers.

use core::fmt;

use super::long::VALUE_LONGEST;
use super::typed::{TypedValue, ValueType};

/// Values are raw numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Scale;

/// Why a text is no value of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unfit {
    /// It is none of its type.
    NoValue,
}

#[allow(missing_docs)] // As what it stands in for.
impl Scale {
    /// Values are raw numbers.
    pub const NONE: Self = Self;

    pub(crate) fn write(self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        Ok(())
    }

    pub fn apply(self, raw: TypedValue<'_>) -> TypedValue<'_> {
        raw
    }

    #[cfg(feature = "mqtt")]
    pub(crate) fn is_none(self) -> bool {
        true
    }

    #[cfg(feature = "mqtt")]
    pub(crate) fn limits(self, value: ValueType, bits: u16) -> Option<[TypedValue<'static>; 3]> {
        let is_signed = value.is_signed()?;
        let above = 1_i64 << if is_signed { bits - 1 } else { bits };
        Some([if is_signed { -above } else { 0 }, above - 1, 1].map(TypedValue::Whole))
    }

    pub fn parse(self, value: ValueType, _: u16, text: &str) -> Result<[u8; VALUE_LONGEST], Unfit> {
        value.parse(text).ok_or(Unfit::NoValue)
    }
}
