//! Values that only ports have: devices, formats, servers, lists of prefixes, what unit ids mean.

use core::net::SocketAddr;

use heapless::{String, Vec};

use super::values::{number, parse_endpoint, prefix};
use super::words::{Word, Words, Wrong};
use super::{INTERFACE_BYTES_MAX, InterfaceName, IpPrefix, MODBUS_TCP_PORT, Parity, RESERVED_MAX, Special};

/// Names the limit as a number.
const DEVICE_EXPECTED: &str = match super::DEVICE_BYTES_MAX {
    255 => "a serial device such as uart1 or /dev/ttyUSB0, at most 255 characters",
    15 => "a serial device such as uart1, at most 15 characters",
    _ => panic!("another text is needed"),
};

/// The device name that `word` is.
pub(super) fn device<const N: usize>(word: Word) -> Result<String<N>, Wrong> {
    graphic(word).ok_or_else(|| word.expected(DEVICE_EXPECTED))
}

/// The name of a network interface that `word` is. Linux takes no slash in one.
pub(super) fn interface(word: Word) -> Result<InterfaceName, Wrong> {
    let name = graphic(word).filter(|name: &InterfaceName| !name.contains('/'));
    name.ok_or_else(|| word.expected("a network interface such as eth1, at most 15 characters"))
}

const _: () = assert!(INTERFACE_BYTES_MAX == 15, "the error text of `interface` names the number");

/// A word of visible characters, if it is not too long.
fn graphic<const N: usize>(word: Word) -> Option<String<N>> {
    let good = !word.is_end() && word.text.bytes().all(|byte| byte.is_ascii_graphic());
    if good { String::try_from(word.text).ok() } else { None }
}

/// Data bits, parity, stop bits: `8E1`.
pub(super) fn format(word: Word) -> Result<(u8, Parity, u8), Wrong> {
    let parsed = match word.text.as_bytes() {
        &[data @ b'7'..=b'8', parity, stop @ b'1'..=b'2'] => {
            let parity = match parity.to_ascii_uppercase() {
                b'N' => Some(Parity::None),
                b'E' => Some(Parity::Even),
                b'O' => Some(Parity::Odd),
                _ => None,
            };
            parity.map(|parity| (data - b'0', parity, stop - b'0'))
        }
        _ => None,
    };
    parsed.ok_or_else(|| word.expected("a format such as 8E1, 7E1, 8N1 or 8N2"))
}

/// Where a server is: `192.168.1.20:502`, `[fe80::1]:502`; without a port number it is Modbus's own.
pub(super) fn server(word: Word) -> Result<SocketAddr, Wrong> {
    parse_endpoint(word.text)
        .filter(|(address, _)| !address.is_unspecified())
        .map(|(address, port)| SocketAddr::new(address, port.unwrap_or(MODBUS_TCP_PORT)))
        .ok_or_else(|| word.expected("the address of a server such as 192.168.1.20 or 192.168.1.20:502"))
}

/// `for 192.168.1.0/24,10.0.0.7`: what stands behind the number of reserved places.
pub(super) fn reserved_for(words: &Words) -> Result<Vec<IpPrefix, RESERVED_MAX>, Wrong> {
    words.take().keyword(&[("for", ())], "for and the addresses that the places are kept for")?;
    prefixes(words.take(), words)
}

/// `192.168.1.0/24,10.0.0.7`, of which the first is `word`.
pub(super) fn prefixes<'w>(
    mut word: Word<'w>,
    words: &'w Words,
) -> Result<Vec<IpPrefix, RESERVED_MAX>, Wrong> {
    let mut prefixes = Vec::new();
    loop {
        if prefixes.push(prefix(word)?).is_err() {
            return Err(word.expected("at most 4 prefixes"));
        }
        let next = words.peek();
        if next.is_end() || !next.listed {
            return Ok(prefixes);
        }
        word = words.take();
    }
}

const _: () = assert!(RESERVED_MAX == 4, "the error text of `prefixes` names the number");

/// What stands behind `replace` is a number, so this is not its meaning yet.
const MEANINGS: &[(&str, Special)] = &[
    ("rules", Special::Rules),
    ("off", Special::Off),
    ("local", Special::Local),
    ("replace", Special::Replace(0)),
];
const ALL_LINES: (&str, Special) = ("all", Special::AllLines);

/// What a special unit id means: `off`, or `replace 7`.
pub(super) fn meaning(word: Word, words: &Words, broadcast: bool) -> Result<Special, Wrong> {
    if broadcast && word.lookup(&[ALL_LINES]).is_some() {
        return Ok(Special::AllLines);
    }
    let expected =
        if broadcast { "rules, off, all, local or replace N" } else { "rules, off, local or replace N" };
    Ok(match word.keyword(MEANINGS, expected)? {
        Special::Replace(_) => Special::Replace(number(words.take(), "a unit id", 1..=247)? as u8),
        meaning => meaning,
    })
}
