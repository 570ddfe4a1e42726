//! Times, bytes and requests as scenarios write them.

use embassy_time::Duration;

/// The words of a sentence; a colon behind one is a word of its own.
pub(crate) fn words(sentence: &str) -> Vec<&str> {
    let mut words = Vec::new();
    for word in sentence.split_whitespace() {
        match word.strip_suffix(':') {
            Some(word) => words.extend([word, ":"]),
            None => words.push(word),
        }
    }
    words
}

/// The words of each of several parts with commas between them.
pub(crate) fn listed<'w>(words: &[&'w str]) -> Vec<Vec<&'w str>> {
    let mut parts = vec![Vec::new()];
    for word in words {
        let (word, is_last) = word.strip_suffix(',').map_or((*word, false), |word| (word, true));
        parts.last_mut().expect("there is always one").push(word);
        if is_last {
            parts.push(Vec::new());
        }
    }
    parts
}

/// `1.5s`, `20ms`, `750us`, `10min`.
pub(crate) fn duration(word: &str) -> Result<Duration, String> {
    let digits = word.trim_end_matches(|letter: char| letter.is_ascii_alphabetic());
    let factor_us = match &word[digits.len()..] {
        "us" => 1.0,
        "ms" => 1e3,
        "s" => 1e6,
        "min" => 60e6,
        _ => return Err(format!("{word} is no time such as 20ms")),
    };
    let value: f64 = digits.parse().map_err(|_| format!("{word} is no time such as 20ms"))?;
    Ok(Duration::from_micros((value * factor_us).round() as u64))
}

/// A decimal number.
pub(crate) fn number<T: std::str::FromStr>(word: &str) -> Result<T, String> {
    word.parse().map_err(|_| format!("{word} is no number that fits here"))
}

/// Hexadecimal bytes, with blanks wherever they help; `00*300` is 300 times the byte.
pub(crate) fn bytes(words: &[&str]) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    for word in words {
        let (digits, times) = match word.split_once('*') {
            Some((digits, times)) => (digits, number(times)?),
            None => (*word, 1),
        };
        if digits.is_empty()
            || digits.len() % 2 != 0
            || !digits.bytes().all(|digit| digit.is_ascii_hexdigit())
        {
            return Err(format!("{word} is no hexadecimal byte such as 0B"));
        }
        let pairs = (0..digits.len()).step_by(2);
        let group: Vec<u8> =
            pairs.filter_map(|at| u8::from_str_radix(&digits[at..at + 2], 16).ok()).collect();
        bytes.extend(group.repeat(times));
    }
    Ok(bytes)
}

/// A request: `read 10 holding registers from 0`, `write register 5 = 1234`, `write coil 5 = on`, or its bytes.
pub(crate) fn request(words: &[&str]) -> Result<Vec<u8>, String> {
    let pdu = |function: u8, address: u16, value: u16| {
        let [address, value] = [address, value].map(u16::to_be_bytes);
        vec![function, address[0], address[1], value[0], value[1]]
    };
    match words {
        ["read", count, table @ .., "from", address] => {
            let function = match table {
                ["coil" | "coils"] => 1,
                ["discrete", "input" | "inputs"] => 2,
                ["holding", "register" | "registers"] => 3,
                ["input", "register" | "registers"] => 4,
                _ => return Err(format!("{} is none of the four tables", table.join(" "))),
            };
            Ok(pdu(function, number(address)?, number(count)?))
        }
        ["write", "coil", address, "=", "on"] => Ok(pdu(5, number(address)?, 0xff00)),
        ["write", "coil", address, "=", "off"] => Ok(pdu(5, number(address)?, 0)),
        ["write", "register", address, "=", value] => Ok(pdu(6, number(address)?, number(value)?)),
        _ => bytes(words),
    }
}
