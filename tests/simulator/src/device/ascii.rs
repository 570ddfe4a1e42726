//! ASCII frames by the letter of the specification, Modbus over Serial Line 2.5.2 and 6.2.1.

/// The LRC of `bytes`: what makes their sum, without carries, zero.
pub fn lrc(bytes: &[u8]) -> u8 {
    (0x100 - bytes.iter().map(|&byte| u32::from(byte)).sum::<u32>() % 0x100) as u8
}

/// The frame of `pdu` from or to `unit`, ended by a line feed.
pub fn frame(unit: u8, pdu: &[u8]) -> Vec<u8> {
    let body = [&[unit], pdu].concat();
    let digits: String =
        body.iter().chain([&lrc(&body)]).map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().concat();
    format!(":{digits}\r\n").into_bytes()
}

/// Unit and PDU of `frame`, when it is whole and intact.
pub fn open(frame: &[u8]) -> Option<(u8, Vec<u8>)> {
    let digits = frame.strip_prefix(b":")?.strip_suffix(b"\r\n")?;
    let is_digit = |digit: &u8| digit.is_ascii_digit() || (b'A'..=b'F').contains(digit);
    if digits.len() % 2 != 0 || frame.len() > 513 || !digits.iter().all(is_digit) {
        return None;
    }
    let text = std::str::from_utf8(digits).ok()?;
    let pairs = (0..text.len()).step_by(2);
    let bytes: Vec<u8> = pairs.filter_map(|at| u8::from_str_radix(&text[at..at + 2], 16).ok()).collect();
    let (&check, body) = bytes.split_last()?;
    (body.len() >= 2 && lrc(body) == check).then(|| (body[0], body[1..].to_vec()))
}

#[cfg(test)]
mod tests {
    use super::{frame, open};

    #[test]
    fn a_frame_is_its_digits_and_their_lrc() {
        assert_eq!(frame(0x11, &[3, 0, 0x6b, 0, 3]), b":1103006B00037E\r\n");
    }

    #[test]
    fn a_frame_opens_only_whole_intact_and_in_capitals() {
        let bytes = frame(0x11, &[3, 0, 0x6b, 0, 3]);
        assert_eq!(open(&bytes), Some((0x11, vec![3, 0, 0x6b, 0, 3])));
        for at in 0..bytes.len() {
            let mut corrupt = bytes.clone();
            corrupt[at] ^= 1;
            assert_eq!(open(&corrupt), None, "{at}");
        }
        assert_eq!(open(&bytes.to_ascii_lowercase()), None);
    }
}
