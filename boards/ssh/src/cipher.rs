//! The cipher `chacha20-poly1305@openssh.com`: OpenSSH's PROTOCOL.chacha20poly1305.

use chacha20::ChaCha20Legacy;
use chacha20::cipher::{KeyInit, KeyIvInit, StreamCipher, StreamCipherSeek};
use poly1305::Poly1305;
use subtle::ConstantTimeEq;
use zeroize::ZeroizeOnDrop;

pub(crate) const TAG_BYTES: usize = 16;
/// Bytes of a packet's length, which has a key of its own.
pub(crate) const LENGTH_BYTES: usize = 4;
/// Where the stream begins that encrypts a packet: behind the block that is the key of its tag.
const PACKET_AT: u32 = 64;

/// The keys of one direction.
#[derive(ZeroizeOnDrop)]
pub(crate) struct Key {
    packet: [u8; 32],
    length: [u8; 32],
}

fn stream(key: &[u8; 32], sequence: u32) -> ChaCha20Legacy {
    ChaCha20Legacy::new(key.into(), &u64::from(sequence).to_be_bytes().into())
}

impl Key {
    pub(crate) const fn new(packet: [u8; 32], length: [u8; 32]) -> Self {
        Self { packet, length }
    }

    /// Decrypts, or encrypts, the length of the packet with this number.
    pub(crate) fn length(&self, sequence: u32, mut length: [u8; LENGTH_BYTES]) -> [u8; LENGTH_BYTES] {
        stream(&self.length, sequence).apply_keystream(&mut length);
        length
    }

    /// The stream that encrypts what follows the length, and what makes the packet's tag.
    fn begin(&self, sequence: u32) -> (ChaCha20Legacy, Poly1305) {
        let mut stream = stream(&self.packet, sequence);
        let mut key = [0; 32];
        stream.apply_keystream(&mut key);
        stream.seek(PACKET_AT);
        (stream, Poly1305::new(&key.into()))
    }

    /// Checks and decrypts `packet`, which begins with the encrypted length; returns whether the tag is right.
    pub(crate) fn open(&self, sequence: u32, packet: &mut [u8], tag: &[u8; TAG_BYTES]) -> bool {
        let (mut stream, authenticator) = self.begin(sequence);
        let computed: [u8; TAG_BYTES] = authenticator.compute_unpadded(packet).into();
        let is_right = bool::from(computed.ct_eq(tag));
        if is_right && let Some(text) = packet.get_mut(LENGTH_BYTES..) {
            stream.apply_keystream(text);
        }
        is_right
    }

    /// Encrypts `packet`; returns its tag.
    pub(crate) fn seal(&self, sequence: u32, packet: &mut [u8]) -> [u8; TAG_BYTES] {
        let (mut stream, authenticator) = self.begin(sequence);
        if let Some((length, text)) = packet.split_first_chunk_mut() {
            *length = self.length(sequence, *length);
            stream.apply_keystream(text);
        }
        authenticator.compute_unpadded(packet).into()
    }
}
