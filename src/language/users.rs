//! The users: `user anna role operator password "$argon2id$..."`, `user anna key ssh-ed25519 AAAAC3...`.

use core::fmt::{self, Display};

use heapless::Vec;

use super::changed::Changed;
use super::listed::listed;
use super::problem::Problem;
use super::values::named;
use super::words::{Word, Words, Wrong};
use crate::settings::{
    MQTT, Name, PATHS, PUBLIC_KEY_BYTES, PasswordHash, PublicKey, Role, SSH, Settings, USER_KEYS_MAX,
    USERS_MAX, User,
};

pub(crate) const ROLES: &[(&str, Role)] =
    &[("viewer", Role::Viewer), ("operator", Role::Operator), ("engineer", Role::Engineer)];
const ROLES_EXPECTED: &str = listed!(ROLES);

/// The type of public keys.
pub(crate) const KEY_TYPE: &str = "ssh-ed25519";
/// How the text of each such key begins: the lengths and the type, in base64.
const KEY_BEGIN: &str = "AAAAC3NzaC1lZDI1NTE5AAAAI";

/// Limits of Argon2's parameters: a hash from elsewhere must not take the gateway's memory or time.
/// Boards have this memory for it and no other.
const MEMORY_KIB_MAX: u32 = if PATHS { 262_144 } else { 32 };
const PASSES_MAX: u32 = 16;
const LANES_MAX: u32 = 16;

const EXPECTED: &str = if SSH {
    "role and viewer, operator or engineer, or key and a public key"
} else {
    "role and viewer, operator or engineer"
};

/// Parses a user up to the end of the line, and stores it. The password of one there is stays unless the line has one.
pub(crate) fn user(settings: &mut Settings, words: &Words<'_>) -> Result<Changed, Wrong> {
    let word = words.take();
    let name = user_name(word)?;
    if SSH && words.peek().is("key") {
        return key(settings, words, word);
    }
    words.take().keyword(&[("role", ())], EXPECTED)?;
    let role = words.take().keyword(ROLES, ROLES_EXPECTED)?;
    let mut password = None;
    if !words.peek().is_end() {
        words.take().keyword(&[("password", ())], "password or the end of the line")?;
        password = Some(hash(words.take_quoted())?);
        words.end()?;
    }
    match settings.user_mut(&name) {
        Some(user) => {
            user.role = role;
            user.password = password.or(user.password.take());
        }
        None => {
            let full = settings.users.push(User { name, role, password, keys: Vec::new() });
            full.map_err(|_| word.error(Problem::UsersFull(USERS_MAX)))?;
        }
    }
    Ok(Changed::Other)
}

/// Parses a public key of the user called `name`, and adds it to the others.
fn key(settings: &mut Settings, words: &Words<'_>, name: Word) -> Result<Changed, Wrong> {
    let (word, key) = public_key(words)?;
    let user = settings.user_mut(name.text).ok_or_else(|| name.error(Problem::NoSuchUser))?;
    if !user.keys.contains(&key) {
        user.keys.push(key).map_err(|_| word.error(Problem::KeysFull(USER_KEYS_MAX)))?;
    }
    Ok(Changed::Other)
}

/// `key ssh-ed25519 AAAAC3...`, and what OpenSSH writes behind it, which is no part of the key.
fn public_key<'w>(words: &'w Words<'_>) -> Result<(Word<'w>, PublicKey), Wrong> {
    words.take().keyword(&[("key", ())], "key and a public key")?;
    words.take().keyword(&[(KEY_TYPE, ())], KEY_TYPE)?;
    let word = words.take();
    let good = is_key(word.text).then(|| PublicKey::try_from(word.text).ok()).flatten();
    Ok((word, good.ok_or_else(|| word.error(Problem::NoKey))?))
}

fn is_key(text: &str) -> bool {
    text.len() == PUBLIC_KEY_BYTES
        && text.starts_with(KEY_BEGIN)
        && text.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"+/".contains(&byte))
}

/// Parses a user's name.
pub(crate) fn user_name(word: Word) -> Result<Name, Wrong> {
    named(word, "a user's name: a letter, then letters, digits, - _ or ., at most 15")
}

/// Deletes a user, or one of the user's public keys.
pub(crate) fn delete_user(settings: &mut Settings, words: &Words<'_>) -> Result<Changed, Wrong> {
    let word = words.take();
    let at = settings.users.iter().position(|user| user.name == word.text);
    let at = at.ok_or_else(|| word.error(Problem::NoSuchUser))?;
    if !SSH || words.peek().is_end() {
        words.end()?;
        settings.users.remove(at);
        return Ok(Changed::Other);
    }
    let (word, key) = public_key(words)?;
    let keys = settings.users.get_mut(at).map(|user| &mut user.keys);
    let place = keys.and_then(|keys| Some((keys.iter().position(|other| *other == key)?, keys)));
    let (place, keys) = place.ok_or_else(|| word.error(Problem::NoSuchKey))?;
    keys.remove(place);
    Ok(Changed::Other)
}

/// A PHC string of Argon2id, version 13h.
fn hash(word: Word) -> Result<PasswordHash, Wrong> {
    let good = is_hash(word.text).then(|| PasswordHash::try_from(word.text).ok()).flatten();
    good.ok_or_else(|| word.error(Problem::NoHash))
}

fn is_hash(text: &str) -> bool {
    let mut parts = text.split('$');
    let mut next = || parts.next().unwrap_or_default();
    if (next(), next(), next()) != ("", "argon2id", "v=19") {
        return false;
    }
    let mut parameters = next().split(',');
    let mut is_within = |key: &str, least: u32, most: u32| {
        let value =
            parameters.next().and_then(|word| word.strip_prefix(key)?.strip_prefix('=')?.parse().ok());
        value.is_some_and(|value: u32| (least..=most).contains(&value))
    };
    // RFC 9106, 3.1: eight blocks for each lane at least.
    let costs =
        is_within("m", 8, MEMORY_KIB_MAX) && is_within("t", 1, PASSES_MAX) && is_within("p", 1, LANES_MAX);
    let is_base64 = |text: &str, least: usize| {
        text.len() >= least && text.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"+/".contains(&byte))
    };
    costs
        && parameters.next().is_none()
        && is_base64(next(), 11)
        && is_base64(next(), 43)
        && parts.next().is_none()
}

/// A valid line of settings as it was typed, without a password or its hash and without a comment, which may be anything.
pub(crate) struct WithoutSecrets<'l>(pub(crate) &'l str);

/// `user NAME role ROLE password`
const USER_WORDS: usize = 5;

impl Display for WithoutSecrets<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words = Words::new(self.0);
        let verb = words.peek().text;
        let shown = if words.peek().is("user") { USER_WORDS } else { usize::MAX };
        let mut before = "";
        for nth in 0..shown {
            if is_secret(verb, before) {
                words.take_quoted();
            }
            let word = words.take();
            before = word.text;
            if word.is_end() {
                break;
            }
            let separator = if nth == 0 {
                ""
            } else if word.listed {
                ","
            } else {
                " "
            };
            write!(f, "{separator}{}", word.text)?;
        }
        Ok(())
    }
}

/// Whether the word behind `before` is the password in the line of a publisher.
fn is_secret(verb: &str, before: &str) -> bool {
    MQTT && verb.eq_ignore_ascii_case("publish") && before.eq_ignore_ascii_case("password")
}

/// The words after `user`, without the password.
impl Display for User {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} role {}", self.name, self.role)
    }
}

impl Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = ROLES.iter().find(|(_, role)| role == self).map_or("", |(name, _)| name);
        f.pad(name)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    #[cfg(feature = "users")] // As its test.
    use super::is_hash;
    use super::is_key;

    #[cfg(feature = "users")] // As its test.
    const GOOD: &str =
        "$argon2id$v=19$m=19456,t=2,p=1$gZiV/M1gPc22ElAH/Jh1Hw$CWOrkoo7oJBQ/iyh7uJ0LO2aLEfrHwTWllSAxT0zRno";

    #[test]
    fn a_public_key_is_one_of_ed25519_in_base64() {
        let good = "AAAAC3NzaC1lZDI1NTE5AAAAIOMqqnkVzrm0SdG6UOoqKLsabgH5C9okWi0dh2l9GKJl";
        assert!(is_key(good));
        for bad in [&good[1..], &good.replace("AAAAI", "AAAAJ"), &good.replace("GKJl", "GK_l"), ""] {
            assert!(!is_key(bad), "{bad}");
        }
        assert!(!is_key(&std::format!("{good}A")));
    }

    /// Images without users have no room for one.
    #[cfg(feature = "users")]
    #[test]
    fn a_hash_is_a_phc_string_of_argon2id_whose_costs_are_bounded() {
        assert!(is_hash(GOOD));
        for (part, other) in [
            ("$argon2id", "argon2id"),
            ("argon2id", "argon2i"),
            ("v=19", "v=16"),
            ("m=19456", "m=7"),
            ("m=19456", "m=262145"),
            ("t=2", "t=0"),
            ("t=2", "t=17"),
            ("p=1", "p=17"),
            ("p=1", "p=1,x=1"),
            ("$gZiV/M1gPc22ElAH/Jh1Hw", ""),
            ("gZiV/M", "gZiV_M"),
            ("xT0zRno", "xT0z"),
            ("xT0zRno", "xT0zRno$"),
        ] {
            assert!(!is_hash(&GOOD.replace(part, other)), "{other}");
        }
    }
}
