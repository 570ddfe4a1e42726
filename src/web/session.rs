//! Sessions: a random token, in a cookie for pages, or as a bearer token for scripts.

use core::fmt::{self, Display};

use embassy_time::Instant;
use picoserve::request::Headers;

use crate::gateway::Gateway;
use crate::gateway::web::Token;
use crate::settings::{Name, Role};

pub(super) const COOKIE: &str = "mobgate-session";

/// A token as text.
pub(super) struct Shown(pub(super) Token);

impl Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

/// Reads a token.
fn parse(text: &str) -> Option<Token> {
    let mut token = Token::default();
    if text.len() != 2 * token.len() || !text.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        return None;
    }
    for (byte, at) in token.iter_mut().zip((0..).step_by(2)) {
        *byte = u8::from_str_radix(text.get(at..at + 2)?, 16).ok()?;
    }
    Some(token)
}

/// The token of a request.
pub(super) struct Shows {
    pub(super) token: Token,
    /// A browser sends it by itself.
    pub(super) by_cookie: bool,
}

impl Shows {
    /// An `Authorization` header counts more than a cookie.
    pub(super) fn of(headers: Headers<'_>) -> Option<Self> {
        if let Some(value) = headers.get("authorization") {
            let (scheme, token) = value.as_str().ok()?.split_once(' ')?;
            let token = scheme.eq_ignore_ascii_case("bearer").then(|| parse(token.trim()))??;
            return Some(Self { token, by_cookie: false });
        }
        let cookies = headers.get("cookie")?.as_str().ok()?;
        let mut cookies = cookies.split(';').filter_map(|cookie| cookie.trim().split_once('='));
        let (_, token) = cookies.find(|(name, _)| *name == COOKIE)?;
        Some(Self { token: parse(token)?, by_cookie: true })
    }
}

/// The session's user, with the current role. A new password or the user's deletion ends the session; only a request that `uses` it
/// prolongs it.
pub(super) fn user(gateway: &Gateway<'_>, token: &Token, uses: bool) -> Option<(Name, Role)> {
    let (name, password) = gateway.web.find(token, Instant::now(), uses)?;
    let role = gateway.settings(|settings| {
        let user = settings.user(&name)?;
        (user.password.as_ref() == Some(&password)).then_some(user.role)
    });
    if role.is_none() {
        gateway.web.end(token);
    }
    Some((name, role?))
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString;

    use super::*;

    #[test]
    fn a_token_is_read_as_it_is_shown_and_nothing_else_is_one() {
        let token = Token::from([0, 1, 0xfe, 0xff, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15]);
        let shown = Shown(token).to_string();
        assert_eq!(parse(&shown), Some(token));
        for wrong in ["", &shown[1..], &shown.replace('f', "g"), &shown.replace("00", "+0"), "é"] {
            assert_eq!(parse(wrong), None, "{wrong}");
        }
    }
}
