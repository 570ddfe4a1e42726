//! Lines of settings from a body: as they are, or made of an object of JSON.

use core::cell::RefCell;
use core::fmt::{self, Write};

use heapless::{String, Vec};
use serde::de::{DeserializeSeed, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_json_core::de::Deserializer as Json;

use crate::language::LineError;
use crate::language::forms::{Shape, forms};
use crate::settings::LINE_BYTES_MAX;

/// Fits the names of all members; a longer name is unknown.
const MEMBER_BYTES_MAX: usize = 24;
/// Columns of all forms of a verb.
const COLUMNS_MAX: usize = 12;

pub(super) type Line = String<LINE_BYTES_MAX>;
type Name = String<MEMBER_BYTES_MAX>;

/// The lines of a body.
#[derive(Clone, Copy)]
pub(super) enum Lines<'b> {
    Text(&'b str),
    Json(&'b str),
}

/// Why lines were not taken.
// Passed on once, and there is no heap for the larger one.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, thiserror::Error)]
pub(super) enum Untaken {
    /// This line, by its number from 1, has an error.
    #[error("{2}")]
    Line(usize, Line, LineError),
    #[error("the body is not as described: {0}")]
    Json(serde_json_core::de::Error),
    #[error("the body is not as described: there is no \"{0}\"")]
    Unknown(Name),
    #[error("the body is not as described: \"{0}\" has no words of a line")]
    NoWords(Name),
}

impl Untaken {
    fn too_long() -> Self {
        Self::Line(0, Line::new(), LineError::too_long())
    }
}

/// Takes a line.
type Take<'t> = &'t mut dyn FnMut(usize, &str) -> Result<(), LineError>;

impl Lines<'_> {
    /// Has each line taken, with its number. Those of an object come in the order in which settings are printed.
    pub(super) fn each(self, take: Take<'_>) -> Result<(), Untaken> {
        match self {
            Self::Text(text) => text.lines().enumerate().try_for_each(|(nth, line)| {
                take(nth + 1, line).map_err(|error| Untaken::Line(nth + 1, cut(line), error))
            }),
            Self::Json(text) => {
                let mut number = 0;
                let mut before = "";
                forms().map(|form| form.verb).try_for_each(|verb| {
                    // Kinds of ports are forms of one verb.
                    if core::mem::replace(&mut before, verb) == verb {
                        return Ok(());
                    }
                    lines_of(verb, text, &mut number, take)
                })?;
                // An object without any is checked, too.
                Ok(())
            }
        }
    }
}

fn cut(line: &str) -> Line {
    let mut text = Line::new();
    line.chars().take_while(|char| text.push(*char).is_ok()).for_each(drop);
    text
}

/// The lines that begin with `verb`.
fn lines_of(verb: &'static str, text: &str, number: &mut usize, take: Take<'_>) -> Result<(), Untaken> {
    let mut unescaped = [0; LINE_BYTES_MAX];
    let mut json = Json::new(text.as_bytes(), Some(&mut unescaped));
    let reader = Reader { verb, state: &RefCell::new(State { number, take, why: None }) };
    let read = Top(&reader).deserialize(&mut json).and_then(|()| json.end().map(drop));
    let why = reader.state.borrow_mut().why.take();
    read.map_err(|error| why.unwrap_or(Untaken::Json(error)))
}

struct State<'s, 't> {
    /// That of the line before.
    number: &'s mut usize,
    take: Take<'t>,
    why: Option<Untaken>,
}

struct Reader<'r, 's, 't> {
    verb: &'static str,
    state: &'r RefCell<State<'s, 't>>,
}

impl Reader<'_, '_, '_> {
    /// Notes why reading ends here.
    fn fail<E: serde::de::Error>(&self, why: Untaken) -> E {
        self.state.borrow_mut().why = Some(why);
        E::custom("")
    }

    fn take<E: serde::de::Error>(&self, line: &Line) -> Result<(), E> {
        let taken = {
            let mut state = self.state.borrow_mut();
            *state.number += 1;
            let number = *state.number;
            (state.take)(number, line).map_err(|error| (number, error))
        };
        taken.map_err(|(number, error)| self.fail(Untaken::Line(number, line.clone(), error)))
    }
}

/// The object of lists.
struct Top<'r, 'a, 's, 't>(&'r Reader<'a, 's, 't>);

impl<'de> DeserializeSeed<'de> for Top<'_, '_, '_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<(), D::Error> {
        from.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for Top<'_, '_, '_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object of lists")
    }

    fn visit_map<M: MapAccess<'de>>(self, mut map: M) -> Result<(), M::Error> {
        while let Some(verb) = map.next_key::<Name>()? {
            if verb == self.0.verb {
                map.next_value_seed(List(self.0))?;
            } else if forms().any(|form| form.verb == verb) {
                map.next_value::<IgnoredAny>()?;
            } else {
                return Err(self.0.fail(Untaken::Unknown(verb)));
            }
        }
        Ok(())
    }
}

/// A list of lines.
struct List<'r, 'a, 's, 't>(&'r Reader<'a, 's, 't>);

impl<'de> DeserializeSeed<'de> for List<'_, '_, '_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<(), D::Error> {
        from.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for List<'_, '_, '_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of objects")
    }

    fn visit_seq<S: SeqAccess<'de>>(self, mut list: S) -> Result<(), S::Error> {
        while list.next_element_seed(Item(self.0))?.is_some() {}
        Ok(())
    }
}

/// The object of a line.
struct Item<'r, 'a, 's, 't>(&'r Reader<'a, 's, 't>);

impl<'de> DeserializeSeed<'de> for Item<'_, '_, '_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<(), D::Error> {
        from.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for Item<'_, '_, '_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<M: MapAccess<'de>>(self, mut map: M) -> Result<(), M::Error> {
        let verb = self.0.verb;
        let columns = columns(verb);
        // Values of columns, in any order, with their places; and the options.
        let (mut values, mut places) = (Line::new(), [(0, 0); COLUMNS_MAX]);
        let mut options = Line::new();
        while let Some(name) = map.next_key::<Name>()? {
            let shape = forms().filter(|form| form.verb == verb).find_map(|form| form.member(&name));
            let Some(shape) = shape else { return Err(self.0.fail(Untaken::Unknown(name))) };
            let column = columns.iter().position(|column| *column == name);
            let out = if column.is_some() { &mut values } else { &mut options };
            let begin = out.len();
            let is_short = column.is_some() || write!(out, " {name} ").is_ok();
            match map.next_value_seed(Value { shape, out })? {
                _ if !is_short => return Err(self.0.fail(Untaken::too_long())),
                None => return Err(self.0.fail(Untaken::NoWords(name))),
                Some(false) => out.truncate(begin),
                Some(true) => {
                    let place = column.and_then(|column| places.get_mut(column));
                    place.into_iter().for_each(|place| *place = (begin, out.len()));
                }
            }
        }
        let mut line = Line::new();
        let mut written = line.write_str(verb);
        for (begin, end) in places {
            let value = values.get(begin..end).unwrap_or_default();
            let separator = if value.is_empty() { "" } else { " " };
            written = written.and_then(|()| write!(line, "{separator}{value}"));
        }
        written
            .and_then(|()| line.write_str(options.trim_end()))
            .map_err(|_| self.0.fail(Untaken::too_long()))?;
        self.0.take(&line)
    }
}

/// The columns of all forms of a verb, in an order that fits each.
fn columns(verb: &str) -> Vec<&'static str, COLUMNS_MAX> {
    let mut all = Vec::new();
    for (name, _) in forms().filter(|form| form.verb == verb).flat_map(|form| form.columns) {
        if !all.contains(name) {
            // As many as there are.
            let _ = all.push(*name);
        }
    }
    all
}

/// A value; whether it is there, or `None` for text that is no words of a line.
struct Value<'o> {
    shape: Shape,
    out: &'o mut Line,
}

impl<'de> DeserializeSeed<'de> for Value<'_> {
    type Value = Option<bool>;

    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<Option<bool>, D::Error> {
        match self.shape {
            Shape::Flag => from.deserialize_bool(self),
            Shape::Number(..) => from.deserialize_u32(self),
            Shape::Text | Shape::Quoted => from.deserialize_str(self),
        }
    }
}

impl Visitor<'_> for Value<'_> {
    type Value = Option<bool>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value as in the schema")
    }

    fn visit_bool<E>(self, is_there: bool) -> Result<Option<bool>, E> {
        Ok(Some(is_there))
    }

    fn visit_u32<E>(self, number: u32) -> Result<Option<bool>, E> {
        Ok(write!(self.out, "{number}").ok().map(|()| true))
    }

    fn visit_str<E>(self, text: &str) -> Result<Option<bool>, E> {
        let written = match self.shape {
            _ if text.contains(|char: char| char == '"' || char.is_control()) => return Ok(None),
            Shape::Quoted => write!(self.out, "\"{text}\""),
            _ if text.split(' ').any(|word| word.is_empty() || word.starts_with('#')) => return Ok(None),
            _ => self.out.write_str(text),
        };
        Ok(written.ok().map(|()| true))
    }
}
