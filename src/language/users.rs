//! The users: `user anna role operator password "$argon2id$..."`.

use core::fmt::{self, Display};

use super::changed::Changed;
use super::listed::listed;
use super::problem::Problem;
use super::values::named;
use super::words::{Word, Words, Wrong};
use crate::settings::{Name, PasswordHash, Role, Settings, USERS_MAX, User};

pub(crate) const ROLES: &[(&str, Role)] =
    &[("viewer", Role::Viewer), ("operator", Role::Operator), ("engineer", Role::Engineer)];
const ROLES_EXPECTED: &str = listed!(ROLES);

/// Limits of Argon2's parameters: a hash from elsewhere must not take the gateway's memory or time.
const MEMORY_KIB_MAX: u32 = 262_144;
const PASSES_MAX: u32 = 16;
const LANES_MAX: u32 = 16;

/// Parses a user up to the end of the line, and stores it. The password of one there is stays unless the line has one.
pub(crate) fn user(settings: &mut Settings, words: &Words<'_>) -> Result<Changed, Wrong> {
    let word = words.take();
    let name = user_name(word)?;
    words.take().keyword(&[("role", ())], "role and viewer, operator or engineer")?;
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
            let full = settings.users.push(User { name, role, password });
            full.map_err(|_| word.error(Problem::UsersFull(USERS_MAX)))?;
        }
    }
    Ok(Changed::Other)
}

/// Parses a user's name.
pub(crate) fn user_name(word: Word) -> Result<Name, Wrong> {
    named(word, "a user's name: a letter, then letters, digits, - _ or ., at most 15")
}

/// Deletes the user of this name.
pub(crate) fn delete_user(settings: &mut Settings, word: Word) -> Result<Changed, Wrong> {
    let at = settings.users.iter().position(|user| user.name == word.text);
    settings.users.remove(at.ok_or_else(|| word.error(Problem::NoSuchUser))?);
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

/// A valid line of settings as it was typed, without the hash of a password and without a comment, which may be anything.
pub(crate) struct WithoutSecrets<'l>(pub(crate) &'l str);

/// `user NAME role ROLE password`
const USER_WORDS: usize = 5;

impl Display for WithoutSecrets<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words = Words::new(self.0);
        let shown = if words.peek().is("user") { USER_WORDS } else { usize::MAX };
        for nth in 0..shown {
            let word = words.take();
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
    use super::is_hash;

    const GOOD: &str =
        "$argon2id$v=19$m=19456,t=2,p=1$gZiV/M1gPc22ElAH/Jh1Hw$CWOrkoo7oJBQ/iyh7uJ0LO2aLEfrHwTWllSAxT0zRno";

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
