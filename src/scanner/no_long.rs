//! Stands in for longer types in images without `long-values`: there are none.

use core::convert::Infallible;
use core::fmt::{self, Display};
use core::marker::PhantomData;

use super::byte_order::ByteOrder;

/// See the file that this one replaces.
pub const LONG_VALUES: bool = false;

/// Bytes of the longest value.
pub(crate) const VALUE_LONGEST: usize = 4;

/// There is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LongType {}

#[allow(missing_docs)] // Never called.
impl LongType {
    pub const fn bits(self) -> u16 {
        match self {}
    }

    pub const fn name(self) -> &'static str {
        match self {}
    }

    pub const fn iec(self) -> &'static str {
        match self {}
    }

    pub(super) const fn number(self) -> u8 {
        match self {}
    }

    // As what asks for it.
    #[cfg(feature = "mqtt")]
    pub(super) const fn is_signed(self) -> Option<bool> {
        match self {}
    }

    pub const fn is_text(self) -> bool {
        match self {}
    }

    pub(super) const fn form(self) -> LongForm {
        match self {}
    }

    pub const fn form_of_bits(self) -> LongForm {
        match self {}
    }

    pub(super) fn take(self, _: &[u8]) -> Option<LongValue<'_>> {
        match self {}
    }

    pub(super) fn parse(self, _: &str) -> Option<[u8; VALUE_LONGEST]> {
        match self {}
    }
}

impl Display for LongType {
    fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {}
    }
}

/// There is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LongForm {}

impl LongForm {
    pub(super) const fn is_of_bits(self) -> bool {
        match self {}
    }

    pub(super) const fn rest(self) -> u16 {
        match self {}
    }

    pub(super) fn turn(self, _: ByteOrder, _: &mut [u8]) {
        match self {}
    }
}

/// There is none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LongValue<'r>(Infallible, PhantomData<&'r ()>);

impl LongValue<'_> {
    // As what asks for it.
    #[cfg(feature = "mqtt")]
    pub(crate) fn never(&self) -> ! {
        match self.0 {}
    }

    // As what asks for it.
    #[cfg(any(feature = "web", feature = "mqtt"))]
    pub(crate) fn write_json(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {}
    }
}

impl Display for LongValue<'_> {
    fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {}
    }
}
