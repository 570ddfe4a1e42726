//! Recognises other protocols at a network console.
//!
//! A web page can make a browser send text of its choice to any reachable port. The lines of that text would run as commands if the
//! request's first line did not reveal it.

use crate::settings::LINE_BYTES_MAX;

/// What a connection carries instead of console lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Foreign {
    /// An HTTP request.
    #[error("this is HTTP")]
    Http,
    /// A TLS record.
    #[error("this is TLS")]
    Tls,
    /// Telnet negotiation.
    #[error("this is a telnet client that negotiates")]
    Telnet,
    /// A first line with NUL, as in binary protocols.
    #[error("the first line is not text")]
    NotText,
    /// A first line longer than a console line may be.
    #[error("the first line is too long")]
    TooLong,
}

/// Start of the version in a request line, after any method and target.
const HTTP: &[u8] = b" http/";
/// The first byte of a handshake record (RFC 8446, 5.1).
const TLS_HANDSHAKE: u8 = 0x16;
/// "Interpret as command" (RFC 854).
const TELNET_IAC: u8 = 0xff;

/// Checks the bytes of a session up to the end of its first line.
#[derive(Debug, Default)]
pub(super) struct Guard {
    /// Bytes of the line so far.
    count: usize,
    /// Bytes of [`HTTP`] matched so far.
    matched: usize,
    /// The first line was text.
    passed: bool,
}

impl Guard {
    /// Checks the next byte; returns the other protocol if it is recognised.
    pub(super) fn feed(&mut self, byte: u8) -> Option<Foreign> {
        if self.passed {
            return None;
        }
        if byte == b'\n' {
            // A blank line is no evidence.
            self.passed = self.count > 0;
            self.matched = 0;
            return None;
        }
        let is_first = self.count == 0;
        self.count += usize::from(!byte.is_ascii_whitespace() || !is_first);
        self.matched = match HTTP.get(self.matched) {
            Some(next) if byte.eq_ignore_ascii_case(next) => self.matched + 1,
            _ => usize::from(byte == b' '),
        };
        match byte {
            TLS_HANDSHAKE if is_first => Some(Foreign::Tls),
            TELNET_IAC if is_first => Some(Foreign::Telnet),
            0 => Some(Foreign::NotText),
            _ if self.matched == HTTP.len() => Some(Foreign::Http),
            _ if self.count > LINE_BYTES_MAX => Some(Foreign::TooLong),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    fn found(bytes: &[u8]) -> Option<Foreign> {
        let mut guard = Guard::default();
        bytes.iter().find_map(|byte| guard.feed(*byte))
    }

    #[test]
    fn requests_of_http_are_known_by_their_version_whatever_method_they_name() {
        for line in
            ["POST / HTTP/1.1\r\n", "\r\n\r\ndelete  http/1.0", "PRI * HTTP/2.0\r\n\r\nSM", "a  HTTP/1.1"]
        {
            assert_eq!(found(line.as_bytes()), Some(Foreign::Http), "{line:?}");
        }
        let long = [b"GET /", &[b'x'; LINE_BYTES_MAX][..]].concat();
        assert_eq!(found(&long), Some(Foreign::TooLong));
    }

    #[test]
    fn tls_telnet_and_binary_protocols_are_known_by_a_byte() {
        assert_eq!(found(b"\x16\x03\x01\x02\x00"), Some(Foreign::Tls));
        assert_eq!(found(b"\xff\xfd\x03"), Some(Foreign::Telnet));
        assert_eq!(found(b"\x00\x03\x00\x08!"), Some(Foreign::NotText));
        assert_eq!(found(b"show\x1b[A\x03"), None);
    }

    #[test]
    fn lines_of_the_console_pass_and_behind_the_first_one_everything_does() {
        assert_eq!(found(b"\r\n  \r\nshow config\r\nlabel HTTP/1.1 \x16\xff\n"), None);
        assert_eq!(found("point p d holding 0 label \"caf\u{e9} http\"\n".as_bytes()), None);
        let full = [b" ".repeat(LINE_BYTES_MAX), b"x".repeat(LINE_BYTES_MAX), b"\n".to_vec()].concat();
        assert_eq!(found(&full), None);
    }
}
