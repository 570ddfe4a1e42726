//! The ed25519 key that signs updates, and whose public half the images trust: a release's own, which is in no repository, or one for
//! development, made in target/. A key's file has 64 hexadecimal digits: the private key of RFC 8032.

use std::fmt::Write as _;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use ed25519_dalek::{Signer, SigningKey};
use sha2::{Digest, Sha512};

use crate::tools::{Outcome, fault, root};

/// Names the file of a release's key.
const VARIABLE: &str = "MOBGATE_SIGNING_KEY";
const SEED_BYTES: usize = 32;

/// A key that signs.
pub(crate) struct Key(SigningKey);

impl Key {
    /// The key that the variable names, for a release.
    pub(crate) fn of_release() -> Outcome<Self> {
        let key = Self::named()?.ok_or(format!("a release is signed: {VARIABLE} names no file of a key"))?;
        if Self::read(&development()).is_ok_and(|development| development.0 == key.0) {
            return Err(format!("{VARIABLE} names the key for development"));
        }
        Ok(key)
    }

    /// The key that the variable names, else the one for development, which is made if there is none.
    pub(crate) fn for_images() -> Outcome<Self> {
        Self::named()?.map_or_else(|| Self::made(&development()), Ok)
    }

    /// Reads the key in this file, or makes one there.
    pub(crate) fn made(file: &Path) -> Outcome<Self> {
        if let Some(folder) = file.parent() {
            std::fs::create_dir_all(folder).map_err(|error| fault(folder, &error))?;
        }
        let created = OpenOptions::new().write(true).create_new(true).mode(0o600).open(file);
        match created {
            Ok(mut created) => {
                let key = SigningKey::from_bytes(&random()?);
                writeln!(created, "{}", hexadecimal(key.as_bytes())).map_err(|error| fault(file, &error))?;
                println!("made {}", file.display());
                Ok(Self(key))
            }
            Err(error) if error.kind() == ErrorKind::AlreadyExists => Self::read(file),
            Err(error) => Err(fault(file, &error)),
        }
    }

    fn named() -> Outcome<Option<Self>> {
        std::env::var_os(VARIABLE).map(|file| Self::read(Path::new(&file))).transpose()
    }

    fn read(file: &Path) -> Outcome<Self> {
        let text = std::fs::read_to_string(file).map_err(|error| fault(file, &error))?;
        let seed = parse(text.trim()).ok_or(fault(file, &"not the 64 hexadecimal digits of a key"))?;
        Ok(Self(SigningKey::from_bytes(&seed)))
    }

    /// The public half as images take it: 64 hexadecimal digits.
    pub(crate) fn public(&self) -> String {
        hexadecimal(self.0.verifying_key().as_bytes())
    }

    /// The signature of an update: that of the firmware's SHA-512, as embassy-boot checks it.
    pub(crate) fn sign(&self, firmware: &[u8]) -> [u8; 64] {
        self.0.sign(&Sha512::digest(firmware)).to_bytes()
    }
}

/// The file of the key for development.
pub(crate) fn development() -> PathBuf {
    root().join("target/development.key")
}

fn random() -> Outcome<[u8; SEED_BYTES]> {
    let mut seed = [0; SEED_BYTES];
    let source = Path::new("/dev/urandom");
    let filled = File::open(source).and_then(|mut source| source.read_exact(&mut seed));
    filled.map(|()| seed).map_err(|error| fault(source, &error))
}

/// Bytes as text.
pub(crate) fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        // A string takes all.
        let _ = write!(text, "{byte:02x}");
        text
    })
}

fn parse(text: &str) -> Option<[u8; SEED_BYTES]> {
    let mut seed = [0; SEED_BYTES];
    if text.len() != 2 * SEED_BYTES || !text.bytes().all(|digit| digit.is_ascii_hexdigit()) {
        return None;
    }
    for (index, byte) in seed.iter_mut().enumerate() {
        *byte = u8::from_str_radix(text.get(2 * index..2 * index + 2)?, 16).ok()?;
    }
    Some(seed)
}

#[cfg(test)]
mod tests {
    use super::{Key, hexadecimal, parse};
    use ed25519_dalek::SigningKey;

    fn key() -> Key {
        Key(SigningKey::from_bytes(&[9; 32]))
    }

    /// As the boards check it: salty's SHA-512, and its ed25519 over the 64 bytes of that.
    fn boards_accept(key: &Key, firmware: &[u8], signature: &[u8; 64]) -> bool {
        let key = salty::PublicKey::try_from(key.0.verifying_key().as_bytes()).unwrap();
        let mut hash = salty::Sha512::new();
        firmware.chunks(7).for_each(|chunk| hash.update(chunk));
        key.verify(&hash.finalize(), &salty::Signature::from(signature)).is_ok()
    }

    #[test]
    fn boards_accept_what_is_signed_and_nothing_else() {
        let firmware: Vec<u8> = (0..5000_u32).map(|index| ((index * index) >> 3) as u8).collect();
        for bytes in [0, 1, 111, 112, 127, 128, 5000] {
            assert!(boards_accept(&key(), &firmware[..bytes], &key().sign(&firmware[..bytes])), "{bytes}");
        }
        let signature = key().sign(&firmware);
        let mut tampered = firmware.clone();
        tampered[4000] ^= 1;
        assert!(!boards_accept(&key(), &tampered, &signature));
        assert!(!boards_accept(&key(), &firmware[..4999], &signature));
        let other = Key(SigningKey::from_bytes(&[8; 32]));
        assert!(!boards_accept(&other, &firmware, &signature));
        assert!(!boards_accept(&key(), &firmware, &[0; 64]));
    }

    #[test]
    fn a_key_is_made_once_and_read_again() {
        let folder = std::env::temp_dir().join(format!("mobgate-key-{}", std::process::id()));
        let file = folder.join("some.key");
        let made = Key::made(&file).unwrap();
        assert_eq!(Key::made(&file).unwrap().public(), made.public());
        std::fs::write(&file, "no key").unwrap();
        assert!(Key::made(&file).is_err());
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_keys_text_reads_back() {
        let seed: [u8; 32] = core::array::from_fn(|index| index as u8 * 8);
        assert_eq!(parse(&hexadecimal(&seed)), Some(seed));
        assert_eq!(parse(&hexadecimal(&seed[1..])), None);
        assert_eq!(parse(&"+1".repeat(32)), None);
    }
}
