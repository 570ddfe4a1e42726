//! Times on a serial line by the specification's numbers (Modbus over Serial Line 2.5.1.1), and not by the gateway's arithmetic: tests
//! hold one against the other. All in nanoseconds, rounded up.

use mobgate::settings::{LineSettings, Parity};

/// Above this speed the silences are fixed.
const FIXED_ABOVE_BAUD: u32 = 19_200;
const T1_5_FIXED_NS: u64 = 750_000;
const T3_5_FIXED_NS: u64 = 1_750_000;

/// A start bit, the data, a parity bit if there is one, stop bits: 11 for 8E1, 10 for 8N1 and 7E1.
pub fn char_bits(line: &LineSettings) -> u64 {
    let parity = if line.parity == Parity::None { 0 } else { 1 };
    1 + u64::from(line.data_bits) + parity + u64::from(line.stop_bits)
}

/// The time of so many characters.
pub fn chars_ns(line: &LineSettings, count: u64) -> u64 {
    half_chars_ns(line, 2 * count)
}

/// The longest silence inside an RTU frame.
pub fn t1_5_ns(line: &LineSettings) -> u64 {
    if line.baud > FIXED_ABOVE_BAUD { T1_5_FIXED_NS } else { half_chars_ns(line, 3) }
}

/// The silence that parts two RTU frames.
pub fn t3_5_ns(line: &LineSettings) -> u64 {
    if line.baud > FIXED_ABOVE_BAUD { T3_5_FIXED_NS } else { half_chars_ns(line, 7) }
}

fn half_chars_ns(line: &LineSettings, count: u64) -> u64 {
    let bits = u128::from(count) * u128::from(char_bits(line));
    (bits * 1_000_000_000).div_ceil(2 * u128::from(line.baud)) as u64
}

#[cfg(test)]
mod tests {
    use mobgate::settings::{LineSettings, Parity};

    use super::{char_bits, chars_ns, t1_5_ns, t3_5_ns};

    /// Baud, data bits, parity, stop bits; bits of a character; nanoseconds of one, of t1.5, of t3.5.
    type Row = (u32, u8, Parity, u8, u64, u64, u64, u64);

    const TABLE: [Row; 10] = [
        (1_200, 8, Parity::Even, 1, 11, 9_166_667, 13_750_000, 32_083_334),
        (4_800, 8, Parity::Odd, 1, 11, 2_291_667, 3_437_500, 8_020_834),
        (9_600, 8, Parity::Even, 1, 11, 1_145_834, 1_718_750, 4_010_417),
        (9_600, 8, Parity::None, 2, 11, 1_145_834, 1_718_750, 4_010_417),
        (9_600, 8, Parity::None, 1, 10, 1_041_667, 1_562_500, 3_645_834),
        (9_600, 7, Parity::Even, 1, 10, 1_041_667, 1_562_500, 3_645_834),
        (19_200, 8, Parity::Even, 1, 11, 572_917, 859_375, 2_005_209),
        (19_200, 8, Parity::None, 1, 10, 520_834, 781_250, 1_822_917),
        (38_400, 8, Parity::Even, 1, 11, 286_459, 750_000, 1_750_000),
        (115_200, 8, Parity::None, 1, 10, 86_806, 750_000, 1_750_000),
    ];

    #[test]
    fn times_are_those_of_the_specification() {
        for (baud, data_bits, parity, stop_bits, bits, char_ns, t1_5, t3_5) in TABLE {
            let line = LineSettings { baud, data_bits, parity, stop_bits, ..LineSettings::DEFAULT };
            assert_eq!(char_bits(&line), bits, "{line:?}");
            let times = [chars_ns(&line, 1), t1_5_ns(&line), t3_5_ns(&line)];
            assert_eq!(times, [char_ns, t1_5, t3_5], "{line:?}");
            // The gateway's, which are rounded up to its clock's microsecond.
            let core = [line.chars(1), line.t1_5(), line.t3_5()].map(|time| time.as_micros());
            assert_eq!(core, [char_ns, t1_5, t3_5].map(|ns| ns.div_ceil(1_000)), "{line:?}");
        }
    }
}
