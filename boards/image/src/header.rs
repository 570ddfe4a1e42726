//! The header of an update file: how long the firmware behind it is, and its signature.

/// What every update file begins with: a name, and the number of this format.
pub(crate) const MAGIC: &[u8; 8] = b"MOBGATE\x01";
/// Bytes of an ed25519 signature.
pub const SIGNATURE_BYTES: usize = 64;
/// Bytes of the header.
pub const HEADER_BYTES: usize = MAGIC.len() + 4 + SIGNATURE_BYTES;

/// The header of an update file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// Bytes of the firmware that follows.
    pub firmware_bytes: u32,
    /// Ed25519 signature (RFC 8032) of the SHA-512 of the firmware.
    pub signature: [u8; SIGNATURE_BYTES],
}

impl Header {
    /// The header as it stands in the file.
    pub fn to_bytes(&self) -> [u8; HEADER_BYTES] {
        let mut bytes = [0; HEADER_BYTES];
        let length = self.firmware_bytes.to_le_bytes();
        let parts = MAGIC.iter().chain(&length).chain(&self.signature);
        bytes.iter_mut().zip(parts).for_each(|(byte, part)| *byte = *part);
        bytes
    }

    /// The header that these bytes are; `None` if they are none, or one of another format.
    pub fn from_bytes(bytes: &[u8; HEADER_BYTES]) -> Option<Self> {
        let (length, signature) = bytes.strip_prefix(MAGIC)?.split_first_chunk()?;
        let signature = signature.first_chunk()?;
        Some(Self { firmware_bytes: u32::from_le_bytes(*length), signature: *signature })
    }
}
