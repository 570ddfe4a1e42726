//! What `mobgate console` and the gateway say to each other besides lines and their responses: a byte at either end.
//!
//! Who sends no such byte (`nc -U`, `socat`) has a session of plain lines, and gets none.

use mobgate::console::{Ended, Mode};

/// The first byte of a client at a terminal: each key is a byte.
const TERMINAL: u8 = 0x01;
/// The first byte of a client that sends lines.
const LINES: u8 = 0x02;

/// The last byte of a session in which every line was carried out.
const DONE: u8 = 0x06;
/// The last byte of one in which some line was refused.
const REFUSED: u8 = 0x15;

/// How a client begins a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Hello {
    /// Without a word.
    None,
    /// As a terminal.
    Terminal,
    /// With lines, whose fate it wants to know.
    Lines,
}

impl Hello {
    /// What the first byte of a session says.
    pub(super) fn of(byte: u8) -> Self {
        match byte {
            TERMINAL => Self::Terminal,
            LINES => Self::Lines,
            _ => Self::None,
        }
    }

    /// The byte that says so, if one does.
    pub(super) fn byte(self) -> Option<u8> {
        match self {
            Self::None => None,
            Self::Terminal => Some(TERMINAL),
            Self::Lines => Some(LINES),
        }
    }

    pub(super) fn mode(self) -> Mode {
        match self {
            Self::Terminal => Mode::Echo,
            Self::None | Self::Lines => Mode::Plain,
        }
    }
}

/// The byte that says how a session has ended.
pub(super) fn farewell(ended: Ended) -> u8 {
    if ended == (Ended::Left { refused: false }) { DONE } else { REFUSED }
}

/// Whether `byte` says that every line was carried out, if it is the last byte of a session. Nothing printed has these bytes.
pub(super) fn carried_out(byte: u8) -> Option<bool> {
    match byte {
        DONE => Some(true),
        REFUSED => Some(false),
        _ => None,
    }
}
