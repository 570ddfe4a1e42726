//! Exact conversion between floats and decimal text: the nearest float, and the shortest text that reads back the same.
//!
//! The routines in `core` are fast, but take 20 kB of tables and code. Here a number is an array of decimal digits, doubled and
//! halved as by hand: fast enough for a console.

use core::fmt::{self, Write};

use heapless::Vec;

/// Most digits of a float, or of the midpoint between two; further digits are cut off.
const DIGITS_MAX: usize = 128;
/// Bits of a mantissa, including the implied one.
const MANTISSA_BITS: u32 = 24;
const IMPLIED: u32 = 1 << (MANTISSA_BITS - 1);
/// The exponent of the last bit of the smallest numbers.
const EXPONENT_MIN: i32 = -149;
const INFINITE: u32 = 0x7f80_0000;
const SIGN: u32 = 1 << 31;

/// A positive number: `0.DIGITS` times ten to the power of `point`, without zeros at either end. The order of the fields makes
/// comparison numeric.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Decimal {
    point: i32,
    digits: Vec<u8, DIGITS_MAX>,
}

impl Decimal {
    /// `whole` times two to the power of `exponent`.
    fn new(mut whole: u32, exponent: i32) -> Self {
        let mut number = Self { point: 0, digits: Vec::new() };
        while whole > 0 {
            // Ten digits fit.
            let _ = number.digits.insert(0, (whole % 10) as u8);
            whole /= 10;
            number.point += 1;
        }
        number.trim();
        for _ in 0..exponent.unsigned_abs() {
            if exponent > 0 { number.double() } else { number.halve() }
        }
        number
    }

    /// Parses a number without sign; `None` if it is not one, empty for 0.
    fn parse(text: &str) -> Option<Self> {
        let (digits, exponent) = match text.split_once('e').or_else(|| text.split_once('E')) {
            Some((digits, exponent)) => {
                (digits, exponent.parse().ok().filter(|ten| (-999..=999).contains(ten))?)
            }
            None => (text, 0),
        };
        let mut number = Self { point: exponent, digits: Vec::new() };
        let (mut is_fraction, mut is_number) = (false, false);
        for byte in digits.bytes() {
            let is_leading = byte == b'0' && number.digits.is_empty();
            match byte {
                b'.' if !is_fraction => is_fraction = true,
                b'0'..=b'9' => {
                    is_number = true;
                    number.point += i32::from(!is_fraction && !is_leading);
                    number.point -= i32::from(is_fraction && is_leading);
                    if !is_leading {
                        // Further digits are cut off.
                        let _ = number.digits.push(byte - b'0');
                    }
                }
                _ => return None,
            }
        }
        number.trim();
        is_number.then_some(number)
    }

    fn trim(&mut self) {
        while self.digits.last() == Some(&0) {
            self.digits.pop();
        }
    }

    fn double(&mut self) {
        let mut carry = 0;
        for digit in self.digits.iter_mut().rev() {
            let twice = 2 * *digit + carry;
            (*digit, carry) = (twice % 10, twice / 10);
        }
        if carry > 0 {
            if self.digits.is_full() {
                self.digits.pop();
            }
            // Room was made above.
            let _ = self.digits.insert(0, carry);
            self.point += 1;
        }
        self.trim();
    }

    fn halve(&mut self) {
        let mut rest = 0;
        for digit in &mut self.digits {
            let value = 10 * rest + *digit;
            (*digit, rest) = (value / 2, value % 2);
        }
        if rest > 0 {
            // A sticky digit for the digits cut off.
            let _ = self.digits.push(5);
        }
        if self.digits.first() == Some(&0) {
            self.digits.remove(0);
            self.point -= 1;
        }
    }

    /// Rounds to the nearest integer, ties to even.
    fn round(&self) -> u32 {
        let digit =
            |at: i32| usize::try_from(at).ok().and_then(|at| self.digits.get(at)).copied().unwrap_or(0);
        let whole = (0..self.point).fold(0, |whole: u32, at| 10 * whole + u32::from(digit(at)));
        let behind = usize::try_from(self.point).map_or(&[][..], |at| self.digits.get(at..).unwrap_or(&[]));
        let up = behind > &[5][..] || (behind == [5] && whole % 2 == 1);
        whole + u32::from(up)
    }

    /// The first `count` digits, rounded down and rounded up.
    fn rounded(&self, count: usize) -> (Self, Self) {
        let mut down = self.clone();
        down.digits.truncate(count);
        let mut up = down.clone();
        while up.digits.last() == Some(&9) {
            up.digits.pop();
        }
        match up.digits.last_mut() {
            Some(last) => *last += 1,
            None => {
                let _ = up.digits.push(1);
                up.point += 1;
            }
        }
        down.trim();
        (down, up)
    }
}

/// The float nearest to `text`: `1.5`, `-2e-3`, `.5`, `inf`, `nan`.
pub(super) fn parse(text: &str) -> Option<f32> {
    let (sign, text) = match text.strip_prefix('-') {
        Some(rest) => (SIGN, rest),
        None => (0, text.strip_prefix('+').unwrap_or(text)),
    };
    let bits = if ["inf", "infinity"].iter().any(|word| text.eq_ignore_ascii_case(word)) {
        INFINITE
    } else if text.eq_ignore_ascii_case("nan") {
        f32::NAN.to_bits()
    } else {
        nearest(Decimal::parse(text)?)
    };
    Some(f32::from_bits(sign | bits))
}

/// The bits of the float nearest to `number`.
fn nearest(mut number: Decimal) -> u32 {
    if number.digits.is_empty() {
        return 0;
    }
    // The largest float has 39 digits; larger numbers would take long to halve.
    if number.point > 39 {
        return INFINITE;
    }
    let (low, high) = (Decimal::new(IMPLIED, 0), Decimal::new(2 * IMPLIED, 0));
    let mut exponent = 0;
    while number >= high {
        number.halve();
        exponent += 1;
    }
    while number < low && exponent > EXPONENT_MIN {
        number.double();
        exponent -= 1;
    }
    // Subnormal numbers have no implied bit; a mantissa rounded up to the next power of two increments the exponent.
    let bits = ((exponent - EXPONENT_MIN) as u32 * IMPLIED).saturating_add(number.round());
    bits.min(INFINITE)
}

/// Writes the shortest text that [`parse`] reads as `value`, without an exponent.
pub(super) fn write(value: f32, out: &mut impl Write) -> fmt::Result {
    let bits = value.to_bits();
    if value.is_nan() {
        return out.write_str("NaN");
    }
    if bits & SIGN != 0 {
        out.write_char('-')?;
    }
    match bits & !SIGN {
        0 => out.write_char('0'),
        INFINITE => out.write_str("inf"),
        bits => write_plain(&shortest(bits), out),
    }
}

/// The shortest number that is nearer to the float `bits` than to any other, and of several the nearest.
fn shortest(bits: u32) -> Decimal {
    let steps = bits / IMPLIED;
    let exact = match steps {
        0 => Decimal::new(bits, EXPONENT_MIN),
        _ => Decimal::new(bits % IMPLIED + IMPLIED, EXPONENT_MIN + steps as i32 - 1),
    };
    for count in 1..exact.digits.len() {
        let (down, up) = exact.rounded(count);
        let upwards = exact.digits.get(count..).is_some_and(|rest| rest >= &[5][..]);
        let (first, second) = if upwards { (up, down) } else { (down, up) };
        for number in [first, second] {
            if nearest(number.clone()) == bits {
                return number;
            }
        }
    }
    exact
}

fn write_plain(number: &Decimal, out: &mut impl Write) -> fmt::Result {
    if number.point <= 0 {
        out.write_str("0.")?;
        (number.point..0).try_for_each(|_| out.write_char('0'))?;
    }
    for (at, digit) in (1..).zip(&number.digits) {
        out.write_char(char::from(b'0' + digit))?;
        if at == number.point && number.digits.len() > at as usize {
            out.write_char('.')?;
        }
    }
    (number.digits.len() as i32..number.point).try_for_each(|_| out.write_char('0'))
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::format;
    use std::string::String;

    use proptest::prelude::*;

    use super::*;

    fn written(value: f32) -> String {
        let mut text = String::new();
        write(value, &mut text).unwrap();
        text
    }

    /// Asks the standard library.
    fn check(value: f32) {
        assert_eq!(written(value), format!("{value}"), "{:08x}", value.to_bits());
        assert_eq!(parse(&written(value)).map(f32::to_bits), Some(value.to_bits()), "{value}");
    }

    #[test]
    fn numbers_at_the_borders_are_written_and_read_as_the_standard_library_does() {
        for steps in 0..255 {
            for near in [0, 1, 2, IMPLIED - 2, IMPLIED - 1] {
                check(f32::from_bits(steps * IMPLIED + near));
            }
        }
        for value in [-0.0, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, 1.5, 230.1, -16_777_216.0, 1e23] {
            check(value);
        }
        assert_eq!(written(f32::NAN), "NaN");
    }

    #[test]
    fn what_is_no_number_is_refused() {
        for text in
            ",-,.,e5,1e,1.5.2,0x10,--1,1e1000,1e-1000,1e1000000000000,infinite".split(',').chain(["1,5"])
        {
            assert_eq!(parse(text), None, "{text}");
        }
    }

    #[test]
    fn texts_are_read_as_the_nearest_number() {
        let middle = "16777217";
        let texts = "1.5 +.5 5. -2e-3 1E3 0 -0.0 inf -Infinity 1e40 1e-60 1e999 0e50 16777219 16777217.0 \
                     -1e-999 3.4028236e38";
        for text in texts.split(' ').chain([middle]) {
            assert_eq!(parse(text).map(f32::to_bits), text.parse::<f32>().ok().map(f32::to_bits), "{text}");
        }
        assert!(parse("nan").is_some_and(f32::is_nan));
        let just_above = format!("{middle}.{}1", "0".repeat(60));
        assert_eq!(parse(&just_above), Some(16_777_218.0));
    }

    fn check_text(text: &str) {
        let expected = text.parse::<f32>().ok().map(f32::to_bits);
        assert_eq!(parse(text).map(f32::to_bits), expected, "{text}");
    }

    #[test]
    fn texts_at_the_middle_between_two_numbers_and_beside_it_are_read_as_the_standard_library_does() {
        let neighbours = [0, 1, 2, 3, IMPLIED / 3, IMPLIED - 2, IMPLIED - 1];
        for bits in (0..255).step_by(15).flat_map(|steps| neighbours.map(|near| steps * IMPLIED + near)) {
            let [low, high] = [bits, bits + 1].map(|bits| f64::from(f32::from_bits(bits)));
            // All digits of both and of the middle fit.
            let middle =
                if high.is_finite() { format!("{:.160}", f64::midpoint(low, high)) } else { continue };
            let middle = middle.trim_end_matches('0');
            check_text(middle);
            check_text(&format!("{middle}000"));
            check_text(&format!("{middle}1"));
            if let Some((before, "")) = middle.rsplit_once('5') {
                check_text(&format!("{before}4{}", "9".repeat(20)));
            }
        }
    }

    #[test]
    fn texts_beyond_the_largest_and_the_smallest_number_are_infinite_and_0() {
        let texts = "3.4e38 3.4028235e38 3.40282357e38 5e38 9.99e38 1e39 99e38 1e41 1e-46 7e-46";
        for text in texts.split(' ') {
            check_text(text);
        }
        for zeros in [30, 37, 38, 39, 40, 45, 46, 130, 300] {
            let zeros = "0".repeat(zeros);
            for text in [
                format!("1{zeros}"),
                format!("3{zeros}.5"),
                format!("0.{zeros}1"),
                format!("{zeros}7.{zeros}8"),
                format!(".{zeros}{zeros}e40"),
                format!("0.{zeros}14e{}", zeros.len()),
            ] {
                check_text(&text);
            }
        }
    }

    #[test]
    fn texts_of_more_digits_than_any_number_has_are_cut_off() {
        for digit in ["9", "5", "86", "4999", "123456789"] {
            let digits = digit.repeat(400 / digit.len());
            for exponent in (-60..45).step_by(13) {
                check_text(&format!("0.{digits}e{exponent}"));
                check_text(&format!("{}.{digits}e{exponent}", &digits[..30]));
            }
        }
    }

    proptest! {
        #[test]
        fn any_number_is_written_and_read_as_the_standard_library_does(bits in any::<u32>()) {
            let value = f32::from_bits(bits);
            if !value.is_nan() {
                check(value);
            }
        }

        #[test]
        fn any_text_is_read_as_the_standard_library_does(text in "[+-]?[0-9]{0,12}\\.?[0-9]{0,30}(e[+-]?[0-9]{1,2})?") {
            let expected = text.parse::<f32>().ok().map(f32::to_bits);
            prop_assert_eq!(parse(&text).map(f32::to_bits), expected, "{}", text);
        }
    }
}
