//! Passwords of users: Argon2id (RFC 9106), computed by a thread, since one takes tens of milliseconds.

use argon2::password_hash::phc::PasswordHash as PhcHash;
use argon2::{Argon2, PasswordHasher, PasswordVerifier};
use mobgate::settings::PasswordHash;

use crate::worker;

/// Compared with where there is no hash: with the costs of [`hash`], so that it takes as long.
const NOBODYS: &str =
    "$argon2id$v=19$m=19456,t=2,p=1$MDEyMzQ1Njc4OWFiY2RlZg$cEbY7tPNlDjQV5iVwpdmxl4qDf6kWX0hwLbro5Ww8VU";

/// Whether `password` is the one of `hash`, a PHC string. Takes as long, and says no, without one.
pub async fn is_right(hash: Option<&str>, password: &str) -> bool {
    let (is_somebodys, hash) = (hash.is_some(), hash.unwrap_or(NOBODYS).to_owned());
    let password = password.to_owned();
    let checked = worker::once(move || {
        let hash = PhcHash::new(&hash).ok()?;
        Argon2::default().verify_password(password.as_bytes(), &hash).ok()
    });
    matches!(checked.await, Ok(Some(()))) && is_somebodys
}

/// The hash of `password` with a random salt: 19 MiB of memory and two passes, as OWASP asks for at least.
pub async fn hash(password: &str) -> Option<PasswordHash> {
    let password = password.to_owned();
    let hashed = worker::once(move || Argon2::default().hash_password(password.as_bytes()).ok());
    PasswordHash::try_from(hashed.await.ok()??.to_string().as_str()).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reactor::block_on;

    #[test]
    fn a_hash_fits_its_password_alone_and_each_has_another_salt() {
        block_on(async {
            let [one, other] = [hash("correct horse").await.unwrap(), hash("correct horse").await.unwrap()];
            assert!(one.starts_with("$argon2id$v=19$m=19456,t=2,p=1$") && one != other, "{one} {other}");
            assert!(
                is_right(Some(&one), "correct horse").await && is_right(Some(&other), "correct horse").await
            );
            assert!(!is_right(Some(&one), "correct hors").await);
            assert!(!is_right(Some("$argon2id$v=19$m=1,t=2,p=1$x$y"), "").await, "no hash");
        });
    }

    #[test]
    fn nobody_has_a_password() {
        let known = PhcHash::new(NOBODYS).unwrap();
        assert_eq!(known.params.to_string(), "m=19456,t=2,p=1", "checked as long as a new one");
        // The hash is known to be of this text, and still says no.
        assert!(Argon2::default().verify_password(b"hunter42", &known).is_ok());
        assert!(!block_on(is_right(None, "hunter42")));
    }
}
