//! The exchange of keys: `curve25519-sha256` (RFC 8731) with a host key of Ed25519, strict as OpenSSH's PROTOCOL 1.10 has it.

use core::ops::Range;

use embedded_io_async::{Read, Write};
use salty::agreement::{PublicKey, SecretKey};
use sha2::{Digest, Sha256};
use subtle::ConstantTimeEq;
use zeroize::{Zeroize, ZeroizeOnDrop};

use crate::Error;
use crate::cipher::Key;
use crate::link::{Agreed, EXCHANGE, HASH_BYTES, IDENTIFICATION, Link};
use crate::wire::{ED25519, Reader, Writer, has};

const METHOD: &str = "curve25519-sha256";
/// The same under the name that it had before the RFC.
const METHOD_BEFORE: &str = "curve25519-sha256@libssh.org";
const METHODS: &str = "curve25519-sha256,curve25519-sha256@libssh.org,kex-strict-s-v00@openssh.com";
const STRICT_CLIENT: &str = "kex-strict-c-v00@openssh.com";
const CIPHER: &str = "chacha20-poly1305@openssh.com";
/// Unused with this cipher, but some clients require a common one.
const AUTHENTICATOR: &str = "hmac-sha2-256-etm@openssh.com,hmac-sha2-256";
const NO_COMPRESSION: &str = "none";

const NEW_KEYS: u8 = 21;
const CLIENT_SHARE: u8 = 30;
const SERVER_SHARE: u8 = 31;

const COOKIE_BYTES: usize = 16;

/// What a client offers.
struct Offer {
    /// There is one of each algorithm in common.
    suits: bool,
    strict: bool,
    /// The next message is a wrong guess, to be ignored.
    guessed_wrong: bool,
}

impl Offer {
    /// Parses the offer, and checks it for each algorithm.
    fn of(payload: &[u8]) -> Result<Self, Error> {
        let mut reader = Reader::new(payload);
        if reader.byte()? != EXCHANGE {
            return Err(Error::MALFORMED);
        }
        reader.bytes(COOKIE_BYTES)?;
        let (methods, host_keys) = (reader.text()?, reader.text()?);
        let mut suits = has(methods, METHOD) || has(methods, METHOD_BEFORE);
        suits &= has(host_keys, ED25519);
        for _ in 0..2 {
            suits &= has(reader.text()?, CIPHER);
        }
        let _authenticators = (reader.text()?, reader.text()?);
        for _ in 0..2 {
            suits &= has(reader.text()?, NO_COMPRESSION);
        }
        let _languages = (reader.text()?, reader.text()?);
        let guesses = reader.flag()?;
        let first = |list: &'_ str, name| list.split(',').next() == Some(name);
        // RFC 4253, 7: a guess is right if both have put the same first.
        let guessed_wrong = guesses && !(first(methods, METHOD) && first(host_keys, ED25519));
        Ok(Self { suits, strict: has(methods, STRICT_CLIENT), guessed_wrong })
    }
}

/// A hash of fields.
struct Hash(Sha256);

impl Hash {
    fn string(&mut self, bytes: &[u8]) {
        self.0.update((bytes.len() as u32).to_be_bytes());
        self.0.update(bytes);
    }

    /// A number without sign (RFC 4251, 5: `mpint`).
    fn number(&mut self, bytes: &[u8]) {
        let start = bytes.iter().position(|byte| *byte != 0).unwrap_or(bytes.len());
        let bytes = bytes.get(start..).unwrap_or_default();
        let is_high = bytes.first().is_some_and(|byte| byte & 0x80 != 0);
        self.0.update((bytes.len() as u32 + u32::from(is_high)).to_be_bytes());
        if is_high {
            self.0.update([0]);
        }
        self.0.update(bytes);
    }
}

/// What keys are derived from (RFC 4253, 7.2).
#[derive(Zeroize, ZeroizeOnDrop)]
struct Shared {
    secret: [u8; 32],
    hash: [u8; HASH_BYTES],
    session: [u8; HASH_BYTES],
}

impl Shared {
    /// The keys of the direction with this letter.
    fn key(&self, letter: u8) -> Key {
        let begin = || {
            let mut hash = Hash(Sha256::new());
            hash.number(&self.secret);
            hash.0.update(self.hash);
            hash.0
        };
        let packet = begin().chain_update([letter]).chain_update(self.session).finalize();
        let length = begin().chain_update(packet).finalize();
        Key::new(packet.into(), length.into())
    }
}

fn write_offer(message: &mut Writer<'_>, cookie: &[u8]) {
    message.bytes(cookie);
    let lists =
        [METHODS, ED25519, CIPHER, CIPHER, AUTHENTICATOR, AUTHENTICATOR, NO_COMPRESSION, NO_COMPRESSION];
    for list in lists {
        message.string(list.as_bytes());
    }
    // Two lists of languages, no guess, and a number for later.
    message.string(b"").string(b"").flag(false).number(0);
}

impl<S: Read + Write> Link<'_, S> {
    /// Agrees on new keys, after the client's offer. A pending future must not be dropped, unless the connection ends.
    pub(crate) async fn exchange(&mut self, offer: Range<usize>) -> Result<(), Error> {
        let offered = self.incoming.payload(offer);
        let Offer { suits, strict, guessed_wrong } = Offer::of(offered)?;
        let strict = self.agreed.as_ref().map_or(strict, |agreed| agreed.strict);
        let mut hash = Hash(Sha256::new());
        hash.string(&self.client);
        hash.string(IDENTIFICATION.as_bytes());
        hash.string(offered);
        let mut cookie = [0; COOKIE_BYTES];
        self.fill_random(&mut cookie)?;
        hash.string(self.outgoing.compose(EXCHANGE, |message| write_offer(message, &cookie))?);
        self.outgoing.send(&mut self.stream).await?;
        if !suits {
            // Only now, so that the client can tell its user which algorithm is missing.
            return Err(Error::NO_COMMON_ALGORITHM);
        }
        if guessed_wrong {
            self.any().await?;
        }
        let shared = self.share(hash).await?;
        self.send(NEW_KEYS, |_| {}).await?;
        self.outgoing.use_key(shared.key(b'D'), strict);
        let response = self.any().await?;
        if self.incoming.payload(response) != [NEW_KEYS] {
            return Err(Error::MALFORMED);
        }
        self.incoming.use_key(shared.key(b'C'), strict);
        if self.agreed.is_none() {
            self.agreed = Some(Agreed { session: shared.session, strict });
        }
        Ok(())
    }

    fn fill_random(&self, bytes: &mut [u8]) -> Result<(), Error> {
        if (self.secrets.random)(bytes) { Ok(()) } else { Err(Error::NO_RANDOM_NUMBERS) }
    }

    /// Exchanges the shares, and signs what both have said, of which `hash` has the beginning.
    async fn share(&mut self, mut hash: Hash) -> Result<Shared, Error> {
        let payload = self.any().await?;
        let (number, mut fields) = self.read(payload)?;
        if number != CLIENT_SHARE {
            return Err(Error::MALFORMED);
        }
        let theirs: [u8; 32] = *fields.array()?;
        let mut seed = [0; 32];
        self.fill_random(&mut seed)?;
        let own = SecretKey::from_seed(&seed);
        seed.zeroize();
        let share = own.public().to_bytes();
        let secret = own.agree(&PublicKey::from(theirs)).to_bytes();
        // RFC 8731, 3: a share of small order makes it zero.
        if bool::from(secret.ct_eq(&[0; 32])) {
            return Err(Error::MALFORMED);
        }
        let host_key = self.secrets.host_key;
        let public = host_key.public.to_bytes();
        let mut blob = [0; 64];
        let mut writer = Writer::new(&mut blob);
        writer.string(ED25519.as_bytes()).string(&public);
        let length = writer.finish().unwrap_or_default();
        hash.string(blob.get(..length).unwrap_or_default());
        hash.string(&theirs);
        hash.string(&share);
        hash.number(&secret);
        let hash: [u8; HASH_BYTES] = hash.0.finalize().into();
        let signature = host_key.sign(&hash).to_bytes();
        self.send(SERVER_SHARE, |message| {
            message.ed25519(&public).string(&share).ed25519(&signature);
        })
        .await?;
        let session = self.agreed.as_ref().map_or(hash, |agreed| agreed.session);
        Ok(Shared { secret, hash, session })
    }
}
