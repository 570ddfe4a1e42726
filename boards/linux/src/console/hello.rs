//! The protocol between `mobgate console` and the gateway: one extra byte at either end of the session.
//!
//! Clients that send no such byte (`nc -U`, `socat`) get a session of plain lines, and no status byte.

use mobgate::console::{Ended, Mode};

/// First byte of a client at a terminal: each key is a byte.
const TERMINAL: u8 = 0x01;
/// First byte of a client that sends lines.
const LINES: u8 = 0x02;

/// Last byte of a session in which every line succeeded.
const DONE: u8 = 0x06;
/// Last byte of a session in which a line was refused.
const REFUSED: u8 = 0x15;

/// How a client starts a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Hello {
    /// Without a hello byte.
    None,
    /// As a terminal, whose every key is sent.
    Terminal,
    /// With lines, and wants the status byte.
    Lines,
}

impl Hello {
    /// Decodes the first byte of a session.
    pub(super) fn of(byte: u8) -> Self {
        match byte {
            TERMINAL => Self::Terminal,
            LINES => Self::Lines,
            _ => Self::None,
        }
    }

    /// The byte to send, if any.
    pub(super) fn byte(self) -> Option<u8> {
        match self {
            Self::None => None,
            Self::Terminal => Some(TERMINAL),
            Self::Lines => Some(LINES),
        }
    }

    pub(super) fn mode(self) -> Mode<'static> {
        match self {
            Self::Terminal => Mode::Echo,
            Self::None | Self::Lines => Mode::Plain,
        }
    }
}

/// The status byte of a session.
pub(super) fn farewell(ended: Ended) -> u8 {
    if ended == (Ended::Left { refused: false }) { DONE } else { REFUSED }
}

/// Decodes a possible status byte, the last one of a session. Console output never contains these bytes.
pub(crate) fn carried_out(byte: u8) -> Option<bool> {
    match byte {
        DONE => Some(true),
        REFUSED => Some(false),
        _ => None,
    }
}
