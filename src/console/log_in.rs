//! Lines other than commands: name and password at log-in, and a new password.

use core::fmt;
use core::mem::take;

use embassy_time::Duration;

use super::asks::{Asks, PASSWORD_BYTES, Password};
use super::session::Session;
use super::wait::Wait;
use crate::gateway::Credential;
use crate::gateway::audit::Topic;
use crate::gateway::enter::Refused;
use crate::gateway::reconfigure;
use crate::hal::System;
use crate::language::{Words, Wrong, user_name};
use crate::settings::{Name, Role, Settings, Time, USERS};

/// Number of wrong passwords after which a session ends.
const FAILURES_MAX: u8 = 3;

/// Why a log-in or a new password is refused.
pub(crate) enum Denied {
    NoUsers,
    Wrong,
    Pause(Duration),
    NoSuchUser,
    Length,
    Differ,
    NoHash,
    /// The command needs another role.
    Role {
        needed: Role,
        own: Role,
    },
    NotLocal,
    Deleted,
}

impl fmt::Display for Denied {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NoUsers => {
                "nobody can log in yet: at the local console, user NAME role engineer, then password NAME"
            }
            Self::Wrong => "no such user, or another password",
            Self::Pause(pause) => return write!(f, "too many failures: try again in {}", Time(*pause)),
            Self::NoSuchUser => "there is no user of this name: user NAME role viewer, operator or engineer",
            Self::Length => {
                return write!(
                    f,
                    "a password has {} to {} characters",
                    PASSWORD_BYTES.start(),
                    PASSWORD_BYTES.end()
                );
            }
            Self::Differ => "the passwords differ",
            Self::NoHash => "this gateway has no users, or no random numbers",
            Self::Role { needed, own } => return write!(f, "needs the role {needed}; yours is {own}"),
            Self::Deleted => "this user was deleted",
            Self::NotLocal => "secrets are shown to engineers at the local console only",
        })
    }
}

impl Session<'_, '_> {
    /// Ends a network session if no user has a password yet.
    pub(super) fn check_users(&mut self) {
        if !USERS {
            return;
        }
        let is_open = !self.user.is_empty() || self.gateway.settings(Settings::can_log_in);
        if self.peer.is_some() && !is_open {
            self.fail(&Denied::NoUsers);
            self.ends = true;
        }
    }

    /// Handles the requested line.
    pub(super) fn answered(&mut self, line: &str, edits: bool) -> Wait {
        match take(&mut self.asks) {
            Asks::Command => Wait::End,
            Asks::User => {
                // No user has a longer name.
                self.asks = Asks::Password(Name::try_from(line.trim_ascii()).unwrap_or_default());
                Wait::End
            }
            Asks::Password(user) => {
                self.asks = Asks::Password(user);
                Wait::LogIn
            }
            Asks::New(_) | Asks::Again(..) if self.role < Role::Engineer => {
                self.fail(&Denied::Role { needed: Role::Engineer, own: self.role })
            }
            Asks::New(_) | Asks::Again(..) if !PASSWORD_BYTES.contains(&line.len()) => {
                self.fail(&Denied::Length)
            }
            Asks::New(user) if edits => {
                self.asks = Asks::Again(user, Password::try_from(line).unwrap_or_default());
                Wait::End
            }
            Asks::Again(_, first) if first != line => self.fail(&Denied::Differ),
            Asks::New(user) | Asks::Again(user, _) => {
                self.asks = Asks::New(user);
                Wait::Password
            }
        }
    }

    /// Reads the user's role from the current settings; the session of a deleted user ends.
    pub(super) fn check_role(&mut self) -> bool {
        if !USERS || self.user.is_empty() {
            return true;
        }
        let role = self.gateway.settings(|settings| settings.user(&self.user).map(|user| user.role));
        match role {
            Some(role) => self.role = role,
            None => {
                self.ends = true;
                self.fail(&Denied::Deleted);
            }
        }
        role.is_some()
    }

    /// Checks the password `typed`.
    pub(super) async fn log_in(&mut self, system: &impl System, typed: &str) {
        let (Asks::Password(name), Some(peer)) = (take(&mut self.asks), self.peer) else { return };
        match self.gateway.enter(system, peer, &name, Credential::Password(typed)).await {
            Ok(user) => (self.user, self.role) = (name, user.role),
            Err(Refused::Pause(pause)) => {
                self.ends = true;
                self.fail(&Denied::Pause(pause));
            }
            Err(Refused::Wrong) => {
                self.failures += 1;
                self.ends = self.failures >= FAILURES_MAX;
                self.asks = Asks::User;
                self.fail(&Denied::Wrong);
            }
        }
    }

    /// `password NAME`
    pub(super) fn password(&mut self, words: &Words<'_>) -> Result<Wait, Wrong> {
        let name = user_name(words.take())?;
        words.end()?;
        if self.gateway.settings(|settings| settings.user(&name).is_none()) {
            return Ok(self.fail(&Denied::NoSuchUser));
        }
        self.asks = Asks::New(name);
        Ok(Wait::End)
    }

    /// Makes `typed` the password of `user`.
    pub(super) async fn set_password(&mut self, system: &impl System, typed: &str) {
        let Asks::New(user) = take(&mut self.asks) else { return };
        match system.hash_password(typed).await {
            Some(hash) => {
                let set = reconfigure::set_password(self.gateway, &user, hash).await;
                match set {
                    Ok(()) => self.audit(Topic::Settings, format_args!("password {user}")),
                    Err(error) => _ = self.fail(&error),
                }
            }
            None => _ = self.fail(&Denied::NoHash),
        }
    }
}
