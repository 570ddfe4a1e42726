//! The users of consoles, with their roles.

use heapless::{String, Vec};

use crate::settings::Name;

/// Whether there are users. Without the feature `users` the image has neither the code nor the memory for them: its console is local.
pub(crate) const USERS: bool = cfg!(feature = "users");

/// Users in the settings.
pub(crate) const USERS_MAX: usize = if USERS { 16 } else { 0 };

/// Longest hash of a password in bytes: Argon2id with a salt of 16 and an output of 32 bytes has 97.
pub(crate) const PASSWORD_HASH_BYTES_MAX: usize = 128;

/// A password's hash as a PHC string: `$argon2id$v=19$m=19456,t=2,p=1$SALT$HASH`.
pub type PasswordHash = String<PASSWORD_HASH_BYTES_MAX>;

/// Whether there are SSH servers, and users have public keys. The core has no SSH: the board speaks it.
pub(crate) const SSH: bool = cfg!(feature = "ssh");

/// Public keys of a user.
pub(crate) const USER_KEYS_MAX: usize = if SSH { 8 } else { 0 };

/// Bytes of a public key's text: base64 of 51 bytes (RFC 8709, 4).
pub(crate) const PUBLIC_KEY_BYTES: usize = 68;

/// A public key of Ed25519 as OpenSSH writes it, without the name of its type: `AAAAC3NzaC1lZDI1NTE5AAAAI...`.
pub(crate) type PublicKey = String<PUBLIC_KEY_BYTES>;

/// What a user may do; each role may do what those before it may.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Role {
    /// Looks at the gateway.
    Viewer,
    /// Reads and writes the devices' values.
    Operator,
    /// Changes settings and firmware.
    Engineer,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct User {
    pub(crate) name: Name,
    pub(crate) role: Role,
    pub(crate) password: Option<PasswordHash>,
    /// Without any, and without a password, the user cannot log in.
    pub(crate) keys: Vec<PublicKey, USER_KEYS_MAX>,
}

pub(crate) type Users = Vec<User, USERS_MAX>;
