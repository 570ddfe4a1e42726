//! Bit arrays in bytes, lowest bit first.

/// Bit `at` of `bytes`.
pub(super) fn bit(bytes: &[u8], at: usize) -> bool {
    bytes.get(at / 8).is_some_and(|byte| byte >> (at % 8) & 1 == 1)
}

/// Copies `count` bits.
pub(crate) fn copy_bits(from: &[u8], from_at: usize, to: &mut [u8], to_at: usize, count: usize) {
    for nth in 0..count {
        let value = bit(from, from_at + nth);
        let at = to_at + nth;
        if let Some(byte) = to.get_mut(at / 8) {
            *byte = *byte & !(1 << (at % 8)) | u8::from(value) << (at % 8);
        }
    }
}
