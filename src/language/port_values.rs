//! Values only used by ports: devices, formats, servers, prefix lists, and the meaning of unit ids.

use heapless::{String, Vec};

use super::values::{number, parse_endpoint, port_number, prefix};
use super::words::{Word, Words, Wrong};
use crate::settings::{
    DEVICE_BYTES_MAX, Host, INTERFACE_BYTES_MAX, InterfaceName, Parity, Prefixes, RESERVED_MAX, SERVERS,
    ServerAddress, ServerName, Special,
};

/// The text contains the limit.
const DEVICE_EXPECTED: &str = match DEVICE_BYTES_MAX {
    255 => "a serial device such as uart1 or /dev/ttyUSB0, at most 255 characters",
    15 => "a serial device such as uart1, at most 15 characters",
    _ => panic!("another text is needed"),
};

/// Parses a device name.
pub(crate) fn device<const N: usize>(word: Word) -> Result<String<N>, Wrong> {
    graphic(word).ok_or_else(|| word.expected(DEVICE_EXPECTED))
}

/// Parses the name of a network interface, which has no slash on Linux.
pub(crate) fn interface(word: Word) -> Result<InterfaceName, Wrong> {
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
pub(crate) fn format(word: Word) -> Result<(u8, Parity, u8), Wrong> {
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

/// The accepted forms depend on the feature.
const SERVER_EXPECTED: &str = match SERVERS {
    true => "the address of a server such as 192.168.1.20 or 192.168.1.20:502, or its name",
    false => "the address of a server such as 192.168.1.20 or 192.168.1.20:502",
};

/// Parses a server address: `192.168.1.20:502`, `[fe80::1]:502`, `meter.example`.
pub(crate) fn server_address(word: Word, default_port: u16) -> Result<ServerAddress, Wrong> {
    let by_address = || {
        let (address, port) = parse_endpoint(word.text).filter(|(address, _)| !address.is_unspecified())?;
        Some((Host::Address(address), port))
    };
    let by_name = || {
        if !SERVERS {
            return None;
        }
        let (name, port) = match word.text.split_once(':') {
            Some((name, port)) => (name, Some(port_number(port)?)),
            None => (word.text, None),
        };
        Some((Host::Name(server_name(name)?), port))
    };
    let (host, port) = by_address().or_else(by_name).ok_or_else(|| word.expected(SERVER_EXPECTED))?;
    Ok(ServerAddress { host, port: port.unwrap_or(default_port) })
}

/// A host name (RFC 1123 2.1): its last label has a letter, or it would be an address.
fn server_name(text: &str) -> Option<ServerName> {
    let is_label = |label: &str| {
        let letters = label.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_');
        letters && (1..=63).contains(&label.len()) && !label.starts_with('-') && !label.ends_with('-')
    };
    let last = text.rsplit('.').next()?;
    let good = text.split('.').all(is_label) && last.bytes().any(|byte| byte.is_ascii_alphabetic());
    if good { ServerName::try_from(text).ok() } else { None }
}

/// `for 192.168.1.0/24,10.0.0.7`, after the number of reserved connections.
pub(crate) fn reserved_for(words: &Words) -> Result<Prefixes, Wrong> {
    words.take().keyword(&[("for", ())], "for and the addresses that the places are kept for")?;
    prefixes(words.take(), words)
}

/// `192.168.1.0/24,10.0.0.7`, of which `word` is the first.
pub(crate) fn prefixes<'w>(mut word: Word<'w>, words: &'w Words) -> Result<Prefixes, Wrong> {
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

/// The number after `replace` is parsed separately.
const MEANINGS: &[(&str, Special)] = &[
    ("rules", Special::Rules),
    ("off", Special::Off),
    ("local", Special::Local),
    ("replace", Special::Replace(0)),
];

const ALL_LINES: (&str, Special) = ("all", Special::AllLines);

/// The meaning of a special unit id: `off`, or `replace 7`.
pub(crate) fn meaning(word: Word, words: &Words, broadcast: bool) -> Result<Special, Wrong> {
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
