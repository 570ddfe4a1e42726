//! Parses values in a line: numbers, times, names, addresses.

use core::fmt;
use core::net::{IpAddr, SocketAddr};
use core::ops::RangeInclusive;

use embassy_time::Duration;

use super::problem::Problem;
use super::words::{Word, Wrong};
use crate::settings::{Endpoint, IPV6, IpPrefix, Name, TcpListen, Time, canonical};

const UNITS_US: [(&str, u64); 5] =
    [("us", 1), ("ms", 1_000), ("s", 1_000_000), ("m", 60_000_000), ("h", 3_600_000_000)];

impl Time {
    /// Parses a time; `None` without a unit (except 0), or finer than a microsecond.
    fn parse(text: &str) -> Option<Duration> {
        if text == "0" {
            return Some(Duration::from_ticks(0));
        }
        let unit_at = text.bytes().position(|byte| byte.is_ascii_alphabetic())?;
        let (number, unit) = text.split_at_checked(unit_at)?;
        let scale = UNITS_US.iter().find(|(name, _)| unit.eq_ignore_ascii_case(name))?.1;
        let (whole, fraction) = number.split_once('.').unwrap_or((number, "0"));
        let parts = digits(fraction)?.checked_mul(scale)?;
        // `digits` bounds the length, so the power fits.
        let per = 10_u32.pow(fraction.len() as u32).into();
        let us = digits(whole)?.checked_mul(scale)?.checked_add(parts / per)?;
        parts.is_multiple_of(per).then_some(Duration::from_micros(us))
    }
}

/// A decimal number of up to nine digits, without sign.
fn digits(text: &str) -> Option<u64> {
    let good = (1..=9).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_digit());
    if good { text.parse().ok() } else { None }
}

/// Parses a time within `range`.
pub(crate) fn time(word: Word, range: &RangeInclusive<Duration>) -> Result<Duration, Wrong> {
    let time = Time::parse(word.text).ok_or_else(|| word.error(Problem::TimeUnit))?;
    if range.contains(&time) {
        return Ok(time);
    }
    Err(word.error(Problem::TimeRange { low: *range.start(), high: *range.end() }))
}

/// Periods of polling, and of writes.
pub(crate) const PERIOD: RangeInclusive<Duration> = Duration::from_millis(1)..=Duration::from_secs(3_600);

/// A time in whole milliseconds.
pub(crate) fn whole_ms(word: Word, range: &RangeInclusive<Duration>) -> Result<u32, Wrong> {
    let period = time(word, range)?;
    let whole = u32::try_from(period.as_millis()).ok();
    let whole = whole.filter(|ms| Duration::from_millis((*ms).into()) == period);
    whole.ok_or_else(|| word.expected("whole milliseconds"))
}

/// Parses a number within `range`; the error says `what` it counts.
pub(crate) fn number(word: Word, what: &'static str, range: RangeInclusive<u32>) -> Result<u32, Wrong> {
    parse_number(word.text)
        .filter(|number| range.contains(number))
        .ok_or_else(|| word.error(Problem::Number { what, low: *range.start(), high: *range.end() }))
}

/// [`number`] for settings of one byte.
pub(crate) fn small(word: Word, what: &'static str, range: RangeInclusive<u8>) -> Result<u8, Wrong> {
    let (low, high) = (u32::from(*range.start()), u32::from(*range.end()));
    let value = number(word, what, low..=high)?;
    u8::try_from(value).map_err(|_| word.error(Problem::Number { what, low, high }))
}

/// [`number`] for settings of two bytes.
pub(crate) fn medium(word: Word, what: &'static str, range: RangeInclusive<u16>) -> Result<u16, Wrong> {
    let (low, high) = (u32::from(*range.start()), u32::from(*range.end()));
    let value = number(word, what, low..=high)?;
    u16::try_from(value).map_err(|_| word.error(Problem::Number { what, low, high }))
}

/// Parses `1-64`, with the first number not above the last, or a single number. The error says what was `expected`.
pub(crate) fn span(
    word: Word,
    range: RangeInclusive<u32>,
    expected: &'static str,
) -> Result<(u32, u32), Wrong> {
    let number = |text| parse_number(text).filter(|number| range.contains(number));
    let (first, last) = word.text.split_once('-').unwrap_or((word.text, word.text));
    match (number(first), number(last)) {
        (Some(first), Some(last)) if first <= last => Ok((first, last)),
        (Some(_), Some(_)) => Err(word.error(Problem::UnitsReversed)),
        _ => Err(word.expected(expected)),
    }
}

/// A decimal number without a sign.
pub(crate) fn parse_number(text: &str) -> Option<u32> {
    digits(text).and_then(|number| u32::try_from(number).ok())
}

/// Words with another meaning in the destination column of a rule.
const RESERVED_NAMES: [&str; 3] = ["local", "discard", "nopath"];

/// Whether `word` may be a name. Names start with a letter, so that a bare number in a rule can mean a TCP port.
pub(crate) fn is_name(word: Word) -> bool {
    let letters = word.text.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-_.".contains(&byte));
    word.text.as_bytes().first().is_some_and(u8::is_ascii_alphabetic)
        && letters
        && !RESERVED_NAMES.iter().any(|reserved| word.is(reserved))
}

/// Parses a port name.
pub(crate) fn name(word: Word) -> Result<Name, Wrong> {
    named(
        word,
        "a port name: a letter, then letters, digits, - _ or ., at most 15, not local, discard or nopath",
    )
}

/// Parses a name; the error says what was `expected`.
pub(crate) fn named(word: Word, expected: &'static str) -> Result<Name, Wrong> {
    let name = if is_name(word) { Name::try_from(word.text).ok() } else { None };
    name.ok_or_else(|| word.expected(expected))
}

/// Parses an address or prefix; bits after the prefix are cleared.
pub(crate) fn prefix(word: Word) -> Result<IpPrefix, Wrong> {
    parse_prefix(word.text)
        .ok_or_else(|| word.expected("an IP address or prefix, such as 192.168.1.7 or 192.168.1.0/24"))
}

fn parse_prefix(text: &str) -> Option<IpPrefix> {
    let (address, length) = match text.split_once('/') {
        Some((address, length)) => (address, Some(parse_number(length)?)),
        None => (text, None),
    };
    let address = parse_address(address)?;
    let bits = if address.is_ipv4() { 32 } else { 128 };
    let length = length.unwrap_or(bits);
    if length > bits {
        return None;
    }
    let (address, length) = match canonical(address) {
        IpAddr::V4(v4) => {
            let length = if bits == 128 { length.checked_sub(96)? } else { length };
            let mask = u32::MAX.checked_shl(32 - length).unwrap_or(0);
            let address = core::net::Ipv4Addr::from_bits(v4.to_bits() & mask);
            (IpAddr::V4(address), length)
        }
        IpAddr::V6(v6) if IPV6 => {
            let mask = u128::MAX.checked_shl(128 - length).unwrap_or(0);
            let address = core::net::Ipv6Addr::from_bits(v6.to_bits() & mask);
            (IpAddr::V6(address), length)
        }
        IpAddr::V6(_) => return None,
    };
    IpPrefix::new(address, length as u8)
}

pub(crate) fn parse_address(text: &str) -> Option<IpAddr> {
    if IPV6 { text.parse().ok() } else { text.parse().ok().map(IpAddr::V4) }
}

/// `192.168.1.20:502`, `[fe80::1]:502`, or just an address.
pub(crate) fn parse_endpoint(text: &str) -> Option<(IpAddr, Option<u16>)> {
    if let Some(address) = parse_address(text) {
        return Some((address, None));
    }
    let colon = text.bytes().rposition(|byte| byte == b':')?;
    let (address, port) = (text.get(..colon)?, text.get(colon + 1..)?);
    let address = match address.strip_prefix('[').and_then(|address| address.strip_suffix(']')) {
        Some(v6) if IPV6 => IpAddr::V6(v6.parse().ok()?),
        _ => IpAddr::V4(address.parse().ok()?),
    };
    Some((address, Some(port_number(port)?)))
}

pub(crate) fn port_number(text: &str) -> Option<u16> {
    parse_number(text).and_then(|port| u16::try_from(port).ok()).filter(|&port| port != 0)
}

/// The listening address of a server: `502`, `127.0.0.1:5020`, `[::1]:502`.
pub(crate) fn listen(word: Word) -> Result<TcpListen, Wrong> {
    parse_listen(word.text)
        .ok_or_else(|| word.expected("a TCP port from 1 to 65535, or ADDRESS:PORT such as 127.0.0.1:5020"))
}

fn parse_listen(text: &str) -> Option<TcpListen> {
    if let Some(port) = port_number(text) {
        return Some(TcpListen { address: None, port });
    }
    let (address, port) = parse_endpoint(text)?;
    Some(TcpListen { address: Some(address), port: port? })
}

impl fmt::Display for TcpListen {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.address {
            None => write!(f, "{}", self.port),
            Some(address) => Endpoint(SocketAddr::new(address, self.port)).fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString;

    use super::*;

    #[test]
    fn times_are_read_with_their_units() {
        let us = |text| Time::parse(text).map(|time| time.as_micros());
        assert_eq!(us("300ms"), Some(300_000));
        assert_eq!(us("1.75ms"), Some(1_750));
        assert_eq!(us("750us"), Some(750));
        assert_eq!(us("1s"), Some(1_000_000));
        assert_eq!(us("2m"), Some(120_000_000));
        assert_eq!(us("1.5H"), Some(5_400_000_000));
        assert_eq!(us("0"), Some(0));
        for bad in
            ["300", "", "ms", ".5s", "5.s", "1.5us", "-1s", "1,5s", "1.2.3s", "1e3s", "9999999999s", "5µs"]
        {
            assert_eq!(us(bad), None, "{bad}");
        }
    }

    #[test]
    fn times_are_written_in_the_shortest_exact_way() {
        let text = |us| Time(Duration::from_micros(us)).to_string();
        assert_eq!(text(0), "0");
        assert_eq!(text(750), "750us");
        assert_eq!(text(1_750), "1.75ms");
        assert_eq!(text(1_005), "1.005ms");
        assert_eq!(text(300_000), "300ms");
        assert_eq!(text(60_000_000), "60s");
        assert_eq!(text(1_000_001), "1000.001ms");
    }

    #[test]
    fn prefixes_are_masked_and_mapped_addresses_become_ipv4() {
        let text = |text| parse_prefix(text).map(|prefix| prefix.to_string());
        assert_eq!(text("192.168.1.77/24").as_deref(), Some("192.168.1.0/24"));
        assert_eq!(text("192.168.1.77").as_deref(), Some("192.168.1.77"));
        assert_eq!(text("10.1.2.3/0").as_deref(), Some("0.0.0.0/0"));
        assert_eq!(text("fe80::1/64").as_deref(), Some("fe80::/64"));
        assert_eq!(text("::ffff:10.0.0.9/104").as_deref(), Some("10.0.0.0/8"));
        for bad in ["192.168.1.0/33", "192.168.1", "::1/129", "1.2.3.4/", "*", "::ffff:1.2.3.4/90"] {
            assert_eq!(text(bad), None, "{bad}");
        }
    }

    #[test]
    fn a_listener_is_a_port_with_or_without_an_address() {
        let text = |text| parse_listen(text).map(|listen| listen.to_string());
        for good in ["502", "127.0.0.1:5020", "[::1]:502"] {
            assert_eq!(text(good).as_deref(), Some(good));
        }
        for bad in ["0", "65536", "::1:502", "[127.0.0.1]:5", "localhost:502", "1.2.3.4:", ":502", ""] {
            assert_eq!(text(bad), None, "{bad}");
        }
    }
}
