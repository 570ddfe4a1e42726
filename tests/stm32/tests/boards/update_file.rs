//! Update files, put together by their description in mobgate-image, and signed with the key that the images trust.

use std::path::PathBuf;

use ed25519_dalek::{Signer, SigningKey};
use sha2::{Digest, Sha512};

/// Where a firmware has its info block, and in it the board's name and the version.
const NAME: usize = 0x408;
const VERSION: usize = 0x418;
/// Bytes of the smallest firmware.
const SMALL_BYTES: usize = 4096;

/// The key of `cargo xtask board`.
fn key() -> SigningKey {
    let development = concat!(env!("CARGO_MANIFEST_DIR"), "/../../target/development.key");
    let file = std::env::var_os("MOBGATE_SIGNING_KEY").map_or_else(|| development.into(), PathBuf::from);
    let text = std::fs::read_to_string(&file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    let digit = |at: usize| u8::from_str_radix(&text[2 * at..2 * at + 2], 16).expect("hexadecimal digits");
    SigningKey::from_bytes(&std::array::from_fn(digit))
}

/// The update file of a firmware.
pub(crate) fn signed(firmware: &[u8]) -> Vec<u8> {
    with_signature(firmware, key().sign(&Sha512::digest(firmware)).to_bytes())
}

/// The same with another signature.
pub(crate) fn with_signature(firmware: &[u8], signature: [u8; 64]) -> Vec<u8> {
    [&b"MOBGATE\x01"[..], &(firmware.len() as u32).to_le_bytes(), &signature, firmware].concat()
}

/// The program as if it were of version 0.`minor`.`patch`, where it says 0.1.0.
pub(crate) fn of_version(program: &[u8], minor: u8, patch: u8) -> Vec<u8> {
    const TEXT: &[u8] = b"0.1.0";
    let mut other = program.to_vec();
    other[VERSION..VERSION + 8].copy_from_slice(&[0, 0, minor, 0, patch, 0, 0xff, 0xff]);
    let places: Vec<usize> =
        program.windows(TEXT.len()).enumerate().filter(|(_, text)| *text == TEXT).map(|(at, _)| at).collect();
    assert!(!places.is_empty(), "the program does not say its version");
    for at in places {
        (other[at + 2], other[at + 4]) = (b'0' + minor, b'0' + patch);
    }
    other
}

/// The beginning of a program that hangs at once, with its board's name and this version.
pub(crate) fn hanging(program: &[u8], minor: u8, patch: u8) -> Vec<u8> {
    /// Behind the info block, where code begins.
    const CODE: usize = 0x420;
    /// `wfi`, and a branch to it.
    const LOOP: [u8; 4] = [0x30, 0xbf, 0xfd, 0xe7];
    let mut small = of_version(program, minor, patch);
    small.truncate(SMALL_BYTES);
    small[CODE..CODE + 4].copy_from_slice(&LOOP);
    // The reset vector is somewhere in the same partition, which begins at a multiple of 128 KiB.
    let reset = u32::from_le_bytes([small[4], small[5], small[6], small[7]]);
    let reset = (reset & !0x1_ffff) + CODE as u32 + 1;
    small[4..8].copy_from_slice(&reset.to_le_bytes());
    small
}

/// The same firmware for another board.
pub(crate) fn of_another_board(firmware: &[u8]) -> Vec<u8> {
    let mut other = firmware.to_vec();
    other[NAME] = b'X';
    other
}
