//! The members that an object in a body may have, and the line of the console that they make.

use core::fmt::Write;

use heapless::String;

use super::reader::Reader;
use super::untaken::Untaken;
use crate::console::PASSWORD_BYTES;
use crate::language::parse_address;
use crate::settings::{ClientRole, Name};

/// Fits the line of a request with 128 values, or a quarter of them without `long-requests`.
pub(super) type Line = String<{ if cfg!(feature = "long-requests") { 4_096 } else { 1_024 } }>;
/// The most members of an object.
const MEMBERS_MAX: usize = 8;

/// What a member is.
#[derive(Clone, Copy)]
pub(super) enum Kind {
    /// Up to so many bytes.
    Text(usize),
    /// One word of a line.
    Word,
    /// Unit identifiers: `1-5`.
    Range,
    /// A data point. A number would be a unit.
    Point,
    /// An IP address, and the role of a client.
    Address,
    Role,
    /// Up to this.
    Number(u32),
    Millis,
    Numbers,
    /// Text in quotes.
    #[cfg(feature = "long-values")] // Only such values are written as text.
    Quoted,
    Flag,
}

pub(super) const BYTE: Kind = Kind::Number(0xff);
pub(super) const WORD: Kind = Kind::Number(0xffff);
/// A name or a password.
pub(super) const TEXT: Kind = Kind::Text(*PASSWORD_BYTES.end());

/// A member: its name, what it is, whether it is needed, and the word before it in a line.
pub(super) struct Member {
    name: &'static str,
    kind: Kind,
    is_needed: bool,
    word: &'static str,
}

pub(super) const fn needed(name: &'static str, kind: Kind) -> Member {
    Member { name, kind, is_needed: true, word: "" }
}

pub(super) const fn optional(name: &'static str, kind: Kind, word: &'static str) -> Member {
    Member { name, kind, is_needed: false, word }
}

/// The port of a request.
pub(super) const fn via(name: &'static str) -> Member {
    Member { name, kind: Kind::Word, is_needed: true, word: "via " }
}

/// The members of a body.
pub(super) struct Members {
    known: &'static [Member],
    /// The values one after another, and where each one is.
    values: Line,
    places: [Option<(usize, usize)>; MEMBERS_MAX],
}

impl Members {
    /// Reads an object of these members. One that is `null` is not there.
    pub(super) fn read(body: &str, known: &'static [Member]) -> Result<Self, Untaken> {
        let mut own = Self { known, values: Line::new(), places: [None; MEMBERS_MAX] };
        let mut reader = Reader::new(body);
        reader.object(&mut |reader, name| own.member(reader, name))?;
        reader.end()?;
        match known.iter().find(|member| member.is_needed && own.get(member.name).is_none()) {
            Some(member) => Err(Untaken::Missing(member.name)),
            None => Ok(own),
        }
    }

    fn member(&mut self, reader: &mut Reader<'_>, name: &str) -> Result<(), Untaken> {
        let mut members = self.known.iter().zip(&mut self.places);
        let Some((member, place)) = members.find(|(member, _)| member.name == name) else {
            return Err(Untaken::unknown(name));
        };
        if !member.is_needed && reader.takes("null") {
            return Ok(());
        }
        if place.is_some() {
            return Err(reader.expected("each member once"));
        }
        let begin = self.values.len();
        member.kind.read(reader, &mut self.values)?;
        *place = Some((begin, self.values.len()));
        let value = self.values.get(begin..).unwrap_or_default();
        if member.kind.fits(value) { Ok(()) } else { Err(Untaken::NotAWord(member.name)) }
    }

    /// The value of a member.
    pub(super) fn get(&self, name: &str) -> Option<&str> {
        let (_, place) = self.known.iter().zip(&self.places).find(|(member, _)| member.name == name)?;
        place.and_then(|(begin, end)| self.values.get(begin..end))
    }

    pub(super) fn number(&self, name: &str) -> Option<u32> {
        self.get(name)?.parse().ok()
    }

    /// The name of a user, if it can be one.
    pub(super) fn user(&self) -> Option<Name> {
        Name::try_from(self.get("user")?).ok()
    }

    /// The password, which outlives what else was read.
    pub(super) fn password(&self) -> String<{ *PASSWORD_BYTES.end() }> {
        self.get("password").and_then(|password| String::try_from(password).ok()).unwrap_or_default()
    }

    pub(super) fn is_set(&self, name: &str) -> bool {
        self.get(name) == Some("true")
    }

    /// Fails unless there are either numbers or a text, where both are known.
    #[cfg(feature = "long-values")] // As text.
    fn check_text(&self) -> Result<(), Untaken> {
        let knows_text = self.known.iter().any(|member| matches!(member.kind, Kind::Quoted));
        let is_there = |member: &&Member| self.get(member.name).is_some_and(|value| !value.is_empty());
        let of_both = |member: &&Member| matches!(member.kind, Kind::Quoted | Kind::Numbers);
        let count = self.known.iter().filter(of_both).filter(is_there).count();
        if knows_text && count != 1 { Err(Untaken::NoValue) } else { Ok(()) }
    }

    /// The line of a verb with these members.
    pub(super) fn line(&self, verb: &str) -> Result<Line, Untaken> {
        #[cfg(feature = "long-values")] // As text.
        self.check_text()?;
        let mut line = Line::new();
        let mut written = line.write_str(verb);
        let mut is_missing = false;
        for Member { name, kind, word, .. } in self.known {
            let value = self.get(name).filter(|value| !value.is_empty());
            let is_bare = word.is_empty() && matches!(kind, Kind::Number(_));
            if let Some(value) = value {
                // A number has its place behind another one, also where that is missing.
                let zero = if is_bare && is_missing { " 0" } else { "" };
                written = written.and_then(|()| write!(line, "{zero} {word}{value}"));
            }
            is_missing = is_bare && value.is_none();
        }
        written.map(|()| line).map_err(|_| Untaken::TooLong)
    }
}

impl Kind {
    /// Appends a value.
    fn read(self, reader: &mut Reader<'_>, out: &mut Line) -> Result<(), Untaken> {
        let begin = out.len();
        let written = match self {
            Self::Text(most) => {
                reader.text(out)?;
                if out.len() - begin > most {
                    return Err(reader.expected("a shorter text"));
                }
                Ok(())
            }
            Self::Word | Self::Range | Self::Point | Self::Address | Self::Role => return reader.text(out),
            Self::Number(most) => write!(out, "{}", reader.whole(most)?),
            Self::Millis => write!(out, "{}ms", reader.whole(u32::MAX)?),
            Self::Numbers => {
                return reader.list(&mut |reader| {
                    let blank = if out.len() > begin { " " } else { "" };
                    let number = reader.number()?;
                    write!(out, "{blank}{number}").map_err(|_| Untaken::TooLong)
                });
            }
            #[cfg(feature = "long-values")] // As the kind.
            Self::Quoted => {
                let quote = |out: &mut Line| out.push('"').map_err(|_| Untaken::TooLong);
                quote(out)?;
                reader.text(out)?;
                return quote(out);
            }
            Self::Flag => write!(out, "{}", reader.flag()?),
        };
        written.map_err(|_| Untaken::TooLong)
    }

    /// Whether a text may stand for it in a line.
    fn fits(self, text: &str) -> bool {
        let is_word =
            !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_graphic() && !b"\"#,".contains(&byte));
        match self {
            Self::Text(_) | Self::Number(_) | Self::Millis | Self::Numbers | Self::Flag => true,
            Self::Word => is_word,
            Self::Range => is_word && text.bytes().all(|byte| byte.is_ascii_digit() || byte == b'-'),
            Self::Point => is_word && text.starts_with(|char: char| char.is_ascii_alphabetic()),
            Self::Address => parse_address(text).is_some(),
            Self::Role => ClientRole::new(text).is_some(),
            #[cfg(feature = "long-values")] // As the kind.
            Self::Quoted => {
                let inside = text.get(1..text.len().saturating_sub(1)).unwrap_or_default();
                !inside.contains(|letter: char| letter == '"' || letter.is_control())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::{String, ToString};

    use super::*;

    const KNOWN: &[Member] = &[
        needed("port", Kind::Word),
        needed("unit", BYTE),
        optional("first", WORD, ""),
        optional("second", WORD, ""),
        optional("wait", Kind::Millis, "timeout "),
        optional("from", Kind::Address, "from "),
        optional("values", Kind::Numbers, ""),
        optional("on", Kind::Flag, ""),
    ];

    fn line(body: &str) -> Result<String, String> {
        let read = Members::read(body, KNOWN).and_then(|members| members.line("do"));
        read.map(|line| line.to_string()).map_err(|error| error.to_string())
    }

    #[test]
    fn members_in_any_order_are_the_words_of_a_line() {
        for (body, words) in [
            (r#"{"unit":7,"port":"P1"}"#, "do P1 7"),
            (r#"{"unit":7,"second":2,"port":"P1","first":1}"#, "do P1 7 1 2"),
            (r#"{"unit":7,"second":2,"port":"P1"}"#, "do P1 7 0 2"),
            (r#"{"values":[1,-2.50,3.0,1e-7],"unit":7,"port":"P1","second":null}"#, "do P1 7 1 -2.50 3 1e-7"),
            (r#"{"from":"::1","wait":50,"unit":7,"port":"P1","values":[]}"#, "do P1 7 timeout 50ms from ::1"),
        ] {
            assert_eq!(line(body).as_deref(), Ok(words), "{body}");
        }
        let members = Members::read(r#"{"unit":7,"port":"P1","on":true}"#, KNOWN).unwrap();
        assert_eq!((members.number("unit"), members.number("first")), (Some(7), None));
        assert!(members.is_set("on") && !members.is_set("port"));
    }

    #[test]
    fn a_wrong_member_is_named() {
        for (body, why) in [
            ("{}", "\"port\" is missing"),
            (r#"{"port":"P1","unit":null}"#, "expected a number at byte 21"),
            (r#"{"port":"P1","unit":256}"#, "expected a whole number, not above its limit at byte 21"),
            (r#"{"port":"P1","unit":1,"port":"P1"}"#, "expected each member once at byte 30"),
            (r#"{"port":"P1","unit":1,"prot":1}"#, "there is no \"prot\""),
            (r#"{"port":"P1 as u16","unit":1}"#, "\"port\" is not one word of its kind"),
            (r#"{"port":"P1","unit":1,"from":"here"}"#, "\"from\" is not one word of its kind"),
        ] {
            let told = line(body).unwrap_err();
            assert!(told.ends_with(why), "{body}: {told}");
        }
        let values = std::vec!["0.123456789"; 512].join(",");
        let long = std::format!("{{\"port\":\"P1\",\"unit\":1,\"values\":[{values}]}}");
        assert_eq!(line(&long).unwrap_err(), "the request is too long");
    }
}
