//! The key that a firmware trusts.

/// Bytes of an ed25519 public key.
pub const PUBLIC_KEY_BYTES: usize = 32;

/// The ed25519 public key that signs the updates of this firmware, from the variable `MOBGATE_PUBLIC_KEY` of its build: 64
/// hexadecimal digits, which `cargo xtask board` sets. A firmware that was built without has none, and takes no update.
pub const PUBLIC_KEY: Option<[u8; PUBLIC_KEY_BYTES]> = match option_env!("MOBGATE_PUBLIC_KEY") {
    Some(text) => match parse(text) {
        Some(key) => Some(key),
        None => panic!("MOBGATE_PUBLIC_KEY is not 64 hexadecimal digits"),
    },
    None => None,
};

const fn parse(text: &str) -> Option<[u8; PUBLIC_KEY_BYTES]> {
    let mut rest = text.as_bytes();
    let mut key = [0; PUBLIC_KEY_BYTES];
    let mut filling: &mut [u8] = &mut key;
    while let ([high, low, after @ ..], [byte, unfilled @ ..]) = (rest, filling) {
        let (Some(high), Some(low)) = (digit(*high), digit(*low)) else { return None };
        *byte = high << 4 | low;
        (rest, filling) = (after, unfilled);
    }
    if text.len() == 2 * PUBLIC_KEY_BYTES { Some(key) } else { None }
}

const fn digit(character: u8) -> Option<u8> {
    match character {
        b'0'..=b'9' => Some(character - b'0'),
        b'a'..=b'f' => Some(character - b'a' + 10),
        b'A'..=b'F' => Some(character - b'A' + 10),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::parse;

    #[test]
    fn a_key_is_64_hexadecimal_digits() {
        let text = "00112233445566778899aabbCCDDEEFF000102030405060708090a0b0c0d0e0f";
        let key = parse(text).unwrap();
        assert_eq!((key[1], key[15], key[31]), (0x11, 0xff, 0x0f));
        assert_eq!(parse(&text[2..]), None);
        assert_eq!(parse(&["00", text].concat()), None);
        assert_eq!(parse(&text.replace('f', "g")), None);
    }
}
