//! Decimal numbers of up to 38 digits, exact where binary ones are not: 235 of tenths is 23.5, whatever the raw value.

use core::fmt::{self, Display};

/// Most digits behind the point of a number that is read.
const DECIMALS_MAX: u8 = 18;

/// `mantissa` divided by ten to the power of `decimals`; no zeros at the end behind the point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Decimal {
    mantissa: i128,
    decimals: u8,
}

impl Decimal {
    /// A whole number.
    pub const fn whole(mantissa: i128) -> Self {
        Self { mantissa, decimals: 0 }
    }

    /// `mantissa` divided by ten to the power of `decimals`.
    pub(super) fn new(mantissa: i128, decimals: u8) -> Self {
        let mut number = Self { mantissa, decimals };
        while number.decimals > 0 && number.mantissa % 10 == 0 {
            number.mantissa /= 10;
            number.decimals -= 1;
        }
        number
    }

    /// Parses `-40`, `0.1` or `.5`: at most 38 digits, of them 18 behind the point.
    pub fn parse(text: &str) -> Option<Self> {
        let (is_negative, digits) = match text.strip_prefix('-') {
            Some(digits) => (true, digits),
            None => (false, text.strip_prefix('+').unwrap_or(text)),
        };
        let (mut mantissa, mut decimals, mut is_fraction, mut is_number) = (0_i128, 0, false, false);
        for byte in digits.bytes() {
            match byte {
                b'.' if !is_fraction => is_fraction = true,
                b'0'..=b'9' => {
                    is_number = true;
                    mantissa = mantissa.checked_mul(10)?.checked_add(i128::from(byte - b'0'))?;
                    decimals += u8::from(is_fraction);
                    if decimals > DECIMALS_MAX {
                        return None;
                    }
                }
                _ => return None,
            }
        }
        is_number.then(|| Self::new(if is_negative { -mantissa } else { mantissa }, decimals))
    }

    /// Mantissa and decimals, if they fit.
    pub(super) fn short(self) -> Option<(i32, u8)> {
        Some((i32::try_from(self.mantissa).ok()?, self.decimals))
    }

    /// Whether binary floating point of 64 bits has it without rounding, or as the nearest number that is written the same.
    pub(super) fn is_short(self) -> bool {
        self.mantissa.unsigned_abs() <= 1 << 53
    }

    /// The product; `None` if it has too many digits.
    pub(super) fn times(self, other: Self) -> Option<Self> {
        let decimals = self.decimals.checked_add(other.decimals)?;
        Some(Self::new(self.mantissa.checked_mul(other.mantissa)?, decimals))
    }

    /// The sum; `None` if it has too many digits.
    pub(super) fn plus(self, other: Self) -> Option<Self> {
        let decimals = self.decimals.max(other.decimals);
        Some(Self::new(self.with(decimals)?.checked_add(other.with(decimals)?)?, decimals))
    }

    pub(super) fn negated(self) -> Self {
        Self { mantissa: -self.mantissa, ..self }
    }

    /// The quotient, rounded to a whole number, halves away from 0; `None` if it has too many digits, or `by` is 0.
    pub(super) fn divided(self, by: Self) -> Option<i128> {
        let above = self.mantissa.checked_mul(ten_to(by.decimals)?)?;
        let below = by.mantissa.checked_mul(ten_to(self.decimals)?)?;
        let (quotient, rest) = (above.checked_div(below)?, above.checked_rem(below)?);
        let rounds = rest.unsigned_abs() >= below.unsigned_abs().div_ceil(2);
        Some(match rounds {
            true if above.is_negative() != below.is_negative() => quotient - 1,
            true => quotient + 1,
            false => quotient,
        })
    }

    /// The nearest binary number.
    pub(crate) fn binary(self) -> f64 {
        self.mantissa as f64 / Self::power(self.decimals)
    }

    /// Ten to the power of `decimals`.
    pub(super) fn power(decimals: u8) -> f64 {
        ten_to(decimals).unwrap_or(i128::MAX) as f64
    }

    /// The mantissa with so many decimals.
    fn with(self, decimals: u8) -> Option<i128> {
        self.mantissa.checked_mul(ten_to(decimals - self.decimals)?)
    }
}

fn ten_to(power: u8) -> Option<i128> {
    10_i128.checked_pow(power.into())
}

impl Display for Decimal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let per = ten_to(self.decimals).unwrap_or(1).unsigned_abs();
        let magnitude = self.mantissa.unsigned_abs();
        let sign = if self.mantissa < 0 { "-" } else { "" };
        write!(f, "{sign}{}", magnitude / per)?;
        match usize::from(self.decimals) {
            0 => Ok(()),
            width => write!(f, ".{:0width$}", magnitude % per),
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString;

    use proptest::prelude::*;

    use super::*;

    fn number(text: &str) -> Decimal {
        Decimal::parse(text).unwrap()
    }

    #[test]
    fn numbers_are_printed_as_they_were_read_without_idle_zeros() {
        for (text, printed) in [
            ("0", "0"),
            ("-0", "0"),
            ("-0.05", "-0.05"),
            ("+1.50", "1.5"),
            (".5", "0.5"),
            ("5.", "5"),
            ("100", "100"),
            ("18446744073709551615", "18446744073709551615"),
            ("0.000000000000000001", "0.000000000000000001"),
        ] {
            assert_eq!(number(text).to_string(), printed, "{text}");
        }
        let digits = "9".repeat(39);
        for bad in ["", "-", ".", "1.2.3", "1e3", "0x10", "1,5", "--1", "0.0000000000000000001", &digits] {
            assert_eq!(Decimal::parse(bad), None, "{bad}");
        }
    }

    #[test]
    fn quotients_are_rounded_to_the_nearest_whole_number() {
        for (above, below, quotient) in [
            ("61.5", "0.1", 615),
            ("1", "2", 1),
            ("-1", "2", -1),
            ("1", "-2", -1),
            ("1", "3", 0),
            ("2", "3", 1),
            ("-2", "3", -1),
            ("7", "1000", 0),
            ("1499.99", "1000", 1),
        ] {
            assert_eq!(number(above).divided(number(below)), Some(quotient), "{above} / {below}");
        }
        assert_eq!(number("1").divided(number("0")), None);
    }

    proptest! {
        /// In thousandths, where whole numbers say what is right.
        #[test]
        fn sums_and_products_are_exact(a in -1_000_000_000..1_000_000_000_i64, b in -1_000_000_000..1_000_000_000_i64) {
            let [x, y] = [a, b].map(|thousandths| Decimal::new(thousandths.into(), 3));
            prop_assert_eq!(x.plus(y), Some(Decimal::new((a + b).into(), 3)));
            prop_assert_eq!(x.times(y), Some(Decimal::new(i128::from(a) * i128::from(b), 6)));
            prop_assert_eq!(number(&x.to_string()), x);
        }
    }
}
