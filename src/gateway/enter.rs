//! Log-in by network: one way for consoles, the web interface and SSH, by password or key.

// Without users nobody logs in.
#![cfg_attr(not(feature = "users"), allow(dead_code))]

use core::net::IpAddr;

use embassy_time::{Duration, Instant};

use super::Gateway;
use super::audit::{Actor, Topic};
use crate::hal::System;
use crate::settings::{Name, User};

/// Credentials.
pub enum Credential<'c> {
    /// A password.
    Password(&'c str),
    /// A public key from the settings; the client has proved that it holds the private key.
    Key(&'c str),
    /// A public key that the client offers and has not proved yet. A client may offer several, so only the first refusal need count.
    Offered {
        /// The key.
        key: &'c str,
        /// Whether it counts as a failure if it is refused.
        counts: bool,
    },
}

/// Why somebody may not log in.
pub(crate) enum Refused {
    /// Too many attempts have failed: the next is possible after this time.
    Pause(Duration),
    Wrong,
}

impl Gateway<'_> {
    /// Whether `user` at `peer` may log in. Writes an audit line; a failure counts towards the pauses.
    pub async fn log_in(&self, system: &impl System, peer: IpAddr, user: &str, by: Credential<'_>) -> bool {
        self.enter(system, peer, user, by).await.is_ok()
    }

    /// Returns the user, or the reason for refusal.
    pub(crate) async fn enter(
        &self,
        system: &impl System,
        peer: IpAddr,
        user: &str,
        by: Credential<'_>,
    ) -> Result<User, Refused> {
        if let Some(pause) = self.attempts(|attempts| attempts.pause(Instant::now(), peer, user)) {
            self.audit_failure(peer, user, "an attempt within the pause");
            // Whole seconds, and not 0.
            return Err(Refused::Pause(Duration::from_secs(pause.as_secs() + 1)));
        }
        let known = self.settings(|settings| settings.user(user).cloned());
        let (can_log_in, good) = match by {
            Credential::Password(typed) => {
                let hash = known.as_ref().and_then(|user| user.password.as_deref());
                (hash.is_some(), system.is_password(hash, typed).await)
            }
            Credential::Key(key) | Credential::Offered { key, .. } => {
                let keys = known.as_ref().map(|user| &user.keys[..]).unwrap_or_default();
                (!keys.is_empty(), keys.iter().any(|own| own == key))
            }
        };
        match (known.filter(|_| can_log_in && good), by) {
            (Some(known), Credential::Offered { .. }) => Ok(known),
            (Some(known), by) => {
                self.attempts(|attempts| attempts.succeeded(peer, user));
                let by = if matches!(by, Credential::Key(_)) { ", by key" } else { "" };
                let actor = Actor::User { name: &known.name, peer };
                self.audit(Topic::LogIn, actor, format_args!("logged in as {}{by}", known.role));
                Ok(known)
            }
            (None, Credential::Offered { counts: false, .. }) => Err(Refused::Wrong),
            (None, by) => {
                // A longer name is nobody's.
                let name = Name::try_from(user).unwrap_or_default();
                self.attempts(|attempts| attempts.failed(Instant::now(), peer, &name, can_log_in));
                let is_password = matches!(by, Credential::Password(_));
                self.audit_failure(peer, user, if is_password { "a wrong password" } else { "a wrong key" });
                Err(Refused::Wrong)
            }
        }
    }

    /// Writes about a failed attempt to log in as `user`. An unknown name is not logged: it may be a password.
    fn audit_failure(&self, peer: IpAddr, user: &str, what: &str) {
        let is_known = self.settings(|settings| settings.user(user).is_some());
        let user = if is_known { user } else { "an unknown user" };
        self.audit_refusal(Topic::LogInFailed, None, Some(peer), format_args!("{what} for {user}"));
    }
}
