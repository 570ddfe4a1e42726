//! Decodes keys: control characters and the escape sequences of ANSI terminals.

/// The function of a key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Key {
    Insert(u8),
    Enter,
    Left,
    Right,
    Home,
    End,
    Earlier,
    Later,
    DeleteLeft,
    DeleteRight,
    DeleteWord,
    DeleteToStart,
    DeleteToEnd,
    ClearScreen,
    Complete,
    Cancel,
    /// Ctrl-D: leaves on an empty line, else deletes to the right.
    Leave,
    /// The terminal reports its columns (xterm, "Ps = 8": the size of the text area in characters).
    Columns(u16),
    /// A byte without a function.
    Unknown,
}

/// The position in an escape sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Keys {
    #[default]
    Ground,
    /// After a CR: a LF or NUL next belongs to it.
    AfterCr,
    Escape,
    /// `ESC O`.
    Application,
    /// `ESC [`, and the first and the last number so far.
    Control {
        number: u8,
        last: u16,
        first: bool,
    },
}

/// The meaning of a byte within lines of text.
pub(super) enum Stripped {
    /// Text.
    Text,
    /// The last byte of a key.
    Key(Key),
    /// Part of a key.
    Nothing,
}

const ESCAPE: u8 = 0x1b;

impl Keys {
    /// Decodes a byte; returns the key that it completes.
    pub(super) fn feed(&mut self, byte: u8) -> Option<Key> {
        match core::mem::take(self) {
            Self::AfterCr if byte == b'\n' || byte == 0 => None,
            Self::Ground | Self::AfterCr => self.plain(byte),
            Self::Escape => {
                *self = match byte {
                    b'[' => Self::Control { number: 0, last: 0, first: true },
                    b'O' => Self::Application,
                    ESCAPE => Self::Escape,
                    _ => Self::Ground,
                };
                None
            }
            Self::Application => Some(final_byte(byte, 0, 0)),
            Self::Control { number, last, first } => match byte {
                b'0'..=b'9' => {
                    let last = last.saturating_mul(10).saturating_add((byte - b'0').into());
                    let number = if first { u8::try_from(last).unwrap_or(u8::MAX) } else { number };
                    *self = Self::Control { number, last, first };
                    None
                }
                // Parameter and intermediate bytes (ECMA-48, 5.4).
                0x20..=0x3f => {
                    *self = Self::Control { number, last: 0, first: false };
                    None
                }
                _ => Some(final_byte(byte, number, last)),
            },
        }
    }

    /// Classifies a byte within lines of text.
    pub(super) fn strip(&mut self, byte: u8) -> Stripped {
        let is_text = !byte.is_ascii_control() || byte.is_ascii_whitespace();
        if byte == b'\n' || *self == Self::Ground && is_text {
            *self = Self::Ground;
            return Stripped::Text;
        }
        self.feed(byte).map_or(Stripped::Nothing, Stripped::Key)
    }

    fn plain(&mut self, byte: u8) -> Option<Key> {
        const fn ctrl(letter: u8) -> u8 {
            letter & 0x1f
        }
        const CTRL: [(u8, Key); 17] = [
            (ctrl(b'A'), Key::Home),
            (ctrl(b'B'), Key::Left),
            (ctrl(b'C'), Key::Cancel),
            (ctrl(b'D'), Key::Leave),
            (ctrl(b'E'), Key::End),
            (ctrl(b'F'), Key::Right),
            (ctrl(b'H'), Key::DeleteLeft),
            (0x7f, Key::DeleteLeft),
            (b'\t', Key::Complete),
            (b'\n', Key::Enter),
            (ctrl(b'K'), Key::DeleteToEnd),
            (ctrl(b'L'), Key::ClearScreen),
            (b'\r', Key::Enter),
            (ctrl(b'N'), Key::Later),
            (ctrl(b'P'), Key::Earlier),
            (ctrl(b'U'), Key::DeleteToStart),
            (ctrl(b'W'), Key::DeleteWord),
        ];
        match byte {
            ESCAPE => *self = Self::Escape,
            b'\r' => *self = Self::AfterCr,
            _ => {}
        }
        match byte {
            ESCAPE | 0 => None,
            b' '..=b'~' => Some(Key::Insert(byte)),
            _ => Some(CTRL.iter().find(|(code, _)| *code == byte).map_or(Key::Unknown, |&(_, key)| key)),
        }
    }
}

/// The key of a sequence with this final byte.
fn final_byte(byte: u8, number: u8, last: u16) -> Key {
    match (byte, number) {
        (b'A', _) => Key::Earlier,
        (b'B', _) => Key::Later,
        (b'C', _) => Key::Right,
        (b'D', _) => Key::Left,
        (b'H', _) | (b'~', 1 | 7) => Key::Home,
        (b'F', _) | (b'~', 4 | 8) => Key::End,
        (b'~', 3) => Key::DeleteRight,
        (b't', 8) => Key::Columns(last),
        _ => Key::Unknown,
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::vec::Vec;

    use super::*;

    fn keys(bytes: &[u8]) -> Vec<Key> {
        let mut keys = Keys::default();
        bytes.iter().filter_map(|&byte| keys.feed(byte)).collect()
    }

    #[test]
    fn every_line_end_is_one_enter() {
        assert_eq!(keys(b"\r\n\r\0\n\n\r\r"), [Key::Enter; 6]);
    }

    #[test]
    fn arrows_and_editing_keys_come_in_both_dialects() {
        assert_eq!(keys(b"\x1b[A\x1bOB\x1b[C\x1bOD"), [Key::Earlier, Key::Later, Key::Right, Key::Left]);
        assert_eq!(keys(b"\x1b[H\x1b[1~\x1b[7~\x1bOH"), [Key::Home; 4]);
        assert_eq!(keys(b"\x1b[F\x1b[4~\x1b[8~"), [Key::End; 3]);
        assert_eq!(
            keys(b"\x1b[3~\x1b[1;5C\x1b[15~x"),
            [Key::DeleteRight, Key::Right, Key::Unknown, Key::Insert(b'x')]
        );
    }

    #[test]
    fn a_terminal_tells_its_columns() {
        assert_eq!(keys(b"\x1b[8;24;132tx"), [Key::Columns(132), Key::Insert(b'x')]);
        assert_eq!(keys(b"\x1b[4;24;132t\x1b[8;1;99999999t"), [Key::Unknown, Key::Columns(u16::MAX)]);
    }

    #[test]
    fn control_letters_edit_and_other_bytes_are_unknown() {
        assert_eq!(
            keys(b"\x01\x05\x0b\x15\x17\x0c\x03\x04\x08\x7f\t"),
            [
                Key::Home,
                Key::End,
                Key::DeleteToEnd,
                Key::DeleteToStart,
                Key::DeleteWord,
                Key::ClearScreen,
                Key::Cancel,
                Key::Leave,
                Key::DeleteLeft,
                Key::DeleteLeft,
                Key::Complete
            ]
        );
        assert_eq!(keys(b"\xc3\xa9\x02\x1a"), [Key::Unknown, Key::Unknown, Key::Left, Key::Unknown]);
    }
}
