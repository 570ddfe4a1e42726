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

/// A user.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct User {
    pub(crate) name: Name,
    pub(crate) role: Role,
    /// Without one the user cannot log in.
    pub(crate) password: Option<PasswordHash>,
}

/// All users.
pub(crate) type Users = Vec<User, USERS_MAX>;
