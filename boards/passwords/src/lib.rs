//! Passwords of users on boards: Argon2id (RFC 9106) in memory of a fixed size.
//!
//! Boards have little memory, so more passes make up for it. The figure `argon2_instructions` of the QEMU board is the cost of a check,
//! during which the processor does nothing else.
#![no_std]
#![forbid(unsafe_code)]

use core::cell::RefCell;
use core::fmt::Write;

use argon2::password_hash::phc::{Output, ParamsString, PasswordHash as PhcHash, Salt};
use argon2::{Algorithm, Argon2, Block, Params, Version};
use mobgate::settings::PasswordHash;

/// Memory of a hash in KiB; hashes in settings that need more are refused.
pub const MEMORY_KIB: u32 = 32;
/// Passes over it.
pub const PASSES: u32 = 16;
/// Bytes of a salt, and of a hash.
const SALT_BYTES: usize = 16;
const HASH_BYTES: usize = 32;
/// Longest hash that is compared.
const HASH_BYTES_MAX: usize = 64;

/// Used where a user has no hash, so that the check takes as long: with the costs of [`Passwords::hash`].
const NOBODYS: &str =
    "$argon2id$v=19$m=32,t=16,p=1$MDEyMzQ1Njc4OWFiY2RlZg$AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA";

/// The memory in which passwords are hashed, one at a time: nothing else runs meanwhile.
pub struct Passwords(RefCell<[Block; MEMORY_KIB as usize]>);

impl Passwords {
    /// All zeros.
    pub const fn new() -> Self {
        Self(RefCell::new([const { Block::new() }; MEMORY_KIB as usize]))
    }

    /// Whether `password` is the one of `hash`, a PHC string. Takes as long, and says no, without one.
    pub fn is_right(&self, hash: Option<&str>, password: &str) -> bool {
        let is_right = self.fits(hash.unwrap_or(NOBODYS), password).unwrap_or(false);
        is_right && hash.is_some()
    }

    /// The hash of `password` with a salt that `random` fills in; it says whether it can.
    pub fn hash(&self, password: &str, random: impl FnOnce(&mut [u8]) -> bool) -> Option<PasswordHash> {
        let mut salt = [0; SALT_BYTES];
        if !random(&mut salt) {
            return None;
        }
        let params = Params::new(MEMORY_KIB, PASSES, 1, Some(HASH_BYTES)).ok()?;
        let mut hash = [0; HASH_BYTES];
        self.compute(params.clone(), password, &salt, &mut hash)?;
        let costs = Params::new(MEMORY_KIB, PASSES, 1, None).ok()?;
        let hash = PhcHash {
            algorithm: Algorithm::Argon2id.ident(),
            version: Some(Version::V0x13.into()),
            params: ParamsString::try_from(&costs).ok()?,
            salt: Salt::new(&salt).ok(),
            hash: Output::new(&hash).ok(),
        };
        let mut text = PasswordHash::new();
        write!(text, "{hash}").ok()?;
        Some(text)
    }

    /// `None`: that is no hash of which this memory is enough.
    fn fits(&self, hash: &str, password: &str) -> Option<bool> {
        let known = PhcHash::new(hash).ok()?;
        let (salt, output) = (known.salt?, known.hash?);
        let mut computed = [0; HASH_BYTES_MAX];
        let computed = computed.get_mut(..output.len())?;
        self.compute(Params::try_from(&known.params).ok()?, password, &salt, computed)?;
        // Compared in constant time.
        Some(Output::new(computed).ok()? == output)
    }

    fn compute(&self, params: Params, password: &str, salt: &[u8], into: &mut [u8]) -> Option<()> {
        let argon2 = Argon2::new(Algorithm::Argon2id, Version::V0x13, params);
        // Never lent twice: nothing is awaited here.
        let mut memory = self.0.try_borrow_mut().ok()?;
        argon2.hash_password_into_with_memory(password.as_bytes(), salt, into, memory.as_mut_slice()).ok()
    }
}

#[cfg(test)]
mod tests {

    use super::*;

    extern crate std;
    use std::boxed::Box;

    /// By `echo -n "let me in" | argon2 0123456789abcdef -id -k 8 -t 1 -p 1 -l 32 -e`, as the core's tests have it.
    const KNOWN: &str =
        "$argon2id$v=19$m=8,t=1,p=1$MDEyMzQ1Njc4OWFiY2RlZg$MbnuQj2xrGASZb+GaVRPOkBaCDUjNErQQKePN3mCUfA";

    #[test]
    fn a_hash_fits_its_password_alone_and_each_salt_has_another() {
        let passwords = Box::new(Passwords::new());
        let salted = |salt: u8| {
            passwords.hash("correct horse", |bytes| {
                bytes.fill(salt);
                true
            })
        };
        let (one, other) = (salted(1).unwrap(), salted(2).unwrap());
        assert_eq!(passwords.hash("correct horse", |_| false), None, "there are no random numbers");
        assert!(one.starts_with("$argon2id$v=19$m=32,t=16,p=1$") && one != other, "{one} {other}");
        assert!(passwords.is_right(Some(&one), "correct horse"));
        assert!(passwords.is_right(Some(&other), "correct horse"));
        assert!(!passwords.is_right(Some(&one), "correct hors"));
        assert!(!passwords.is_right(None, ""));
    }

    #[test]
    fn hashes_of_others_are_right_and_those_that_need_more_memory_are_not() {
        let passwords = Box::new(Passwords::new());
        assert!(passwords.is_right(Some(KNOWN), "let me in"));
        for bad in [KNOWN.replace("m=8", "m=64"), KNOWN.replace("MbnuQ", "NbnuQ"), "$argon2id$".into()] {
            assert!(!passwords.is_right(Some(&bad), "let me in"), "{bad}");
        }
        assert!(PhcHash::new(NOBODYS).is_ok(), "it takes its time");
    }
}
