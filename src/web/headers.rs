//! The headers of responses.

use core::fmt::{self, Display};

use embassy_time::Duration;

use super::routes::Methods;
use super::session::{COOKIE, Shown};

/// Sent with each response: it must be neither cached nor framed.
pub(super) const HEADERS: &[(&str, &str)] = &[
    ("Cache-Control", "no-store"),
    ("X-Content-Type-Options", "nosniff"),
    ("Content-Security-Policy", "default-src 'none'; frame-ancestors 'none'"),
];

/// Those, or those of a file with its tag, and one of [`Header`].
pub(super) const HEADERS_MAX: usize = 7;

/// Sent with each file of the page: it runs its own scripts only, and is no part of another page. A browser asks whether it has changed.
pub(super) const FILE_HEADERS: &[(&str, &str)] = &[
    ("Cache-Control", "no-cache"),
    ("X-Content-Type-Options", "nosniff"),
    ("Referrer-Policy", "no-referrer"),
    (
        "Content-Security-Policy",
        "default-src 'self'; base-uri 'none'; form-action 'self'; object-src 'none'; frame-ancestors 'none'",
    ),
    ("Content-Encoding", "gzip"),
];

/// A header of one response.
pub(super) enum Header {
    /// What the path takes.
    Allow(Methods),
    /// A log-in is needed.
    Authenticate,
    RetryAfter(Duration),
    /// The session, which nothing but TLS may carry if it is `true`; without one, its end.
    Cookie(Option<Shown>, bool),
}

impl Header {
    pub(super) const fn name(&self) -> &'static str {
        match self {
            Self::Allow(_) => "Allow",
            Self::Authenticate => "WWW-Authenticate",
            Self::RetryAfter(_) => "Retry-After",
            Self::Cookie(..) => "Set-Cookie",
        }
    }
}

impl Display for Header {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Allow(methods) => methods.fmt(f),
            Self::Authenticate => f.write_str("Bearer"),
            Self::RetryAfter(pause) => pause.as_secs().fmt(f),
            Self::Cookie(token, encrypted) => {
                write!(f, "{COOKIE}=")?;
                let ends = token.is_none();
                token.iter().try_for_each(|token| token.fmt(f))?;
                // The page's scripts cannot read it, and no other page sends it.
                f.write_str("; HttpOnly; SameSite=Strict; Path=/")?;
                f.write_str(if *encrypted { "; Secure" } else { "" })?;
                f.write_str(if ends { "; Max-Age=0" } else { "" })
            }
        }
    }
}
