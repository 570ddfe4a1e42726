//! The settings as lines, or as JSON: an object with a list for each verb, whose items have the members of a line by name. The schema
//! follows from the same forms.

use core::fmt::{self, Write};

use heapless::String;

use super::json::Quoted;
use super::piece::Piece;
use crate::gateway::{Candidate, Gateway};
use crate::language::forms::{Form, Shape, forms, members};
use crate::language::{Shown, write_shown_line};
use crate::settings::{LINE_BYTES_MAX, Settings};

const SCHEMA: &str = "{\"$schema\":\"https://json-schema.org/draft/2020-12/schema\",\"title\":\"Settings of mobgate\",\
    \"type\":\"object\",\"additionalProperties\":false,\"properties\":{";

/// Settings that are being written.
#[derive(Clone)]
pub(super) struct Written {
    /// Those of the candidate, or those in force.
    of_candidate: bool,
    as_json: bool,
    /// The next line.
    line: usize,
    /// The verb of the line before.
    verb: &'static str,
    is_over: bool,
}

impl Written {
    pub(super) fn new(of_candidate: bool, as_json: bool) -> Self {
        Self { of_candidate, as_json, line: 0, verb: "", is_over: false }
    }

    pub(super) fn is_json(&self) -> bool {
        self.as_json
    }

    /// Writes the next piece; `false`: there was none.
    pub(super) fn next(&mut self, gateway: &Gateway<'_>, out: &mut Piece) -> Result<bool, fmt::Error> {
        match self.of_candidate.then(|| gateway.candidate().map(Candidate::settings)) {
            Some(Some(Ok(settings))) => self.next_of(&settings, out),
            Some(_) => self.end(out),
            None => gateway.settings(|settings| self.next_of(settings, out)),
        }
    }

    /// Writes the next piece of these settings.
    pub(super) fn next_of(&mut self, settings: &Settings, out: &mut Piece) -> Result<bool, fmt::Error> {
        let mut line = String::<LINE_BYTES_MAX>::new();
        if self.is_over {
            return Ok(false);
        }
        let Some(written) = write_shown_line(settings, self.line, Shown::Apart, &mut line) else {
            return self.end(out);
        };
        written?;
        self.line += 1;
        match self.as_json {
            true => self.item(&line, out)?,
            false => writeln!(out, "{line}")?,
        }
        Ok(true)
    }

    fn end(&mut self, out: &mut Piece) -> Result<bool, fmt::Error> {
        let is_more = self.as_json && !self.is_over;
        self.is_over = true;
        if is_more {
            out.write_str(if self.verb.is_empty() { "{}" } else { "]}" })?;
        }
        Ok(is_more)
    }

    /// The object of a line.
    fn item(&mut self, line: &str, out: &mut Piece) -> fmt::Result {
        let mut is_first = true;
        members(line, &mut |verb, (name, shape), words| {
            if is_first && verb != self.verb {
                let before = if self.verb.is_empty() { "{" } else { "]," };
                write!(out, "{before}\"{verb}\":[")?;
                self.verb = verb;
            } else if is_first {
                out.write_str(",")?;
            }
            write!(out, "{}\"{name}\":", if is_first { "{" } else { "," })?;
            is_first = false;
            match shape {
                Shape::Flag => out.write_str("true"),
                Shape::Number(..) => out.write_str(words),
                Shape::Text | Shape::Quoted => write!(out, "{}", Quoted(words)),
            }
        })?;
        out.write_str("}")
    }
}

/// The schema that is being written.
#[derive(Default, Clone)]
pub(super) struct Schema {
    /// The next form.
    form: usize,
    is_over: bool,
}

impl Schema {
    /// Writes the next piece; `false`: there was none.
    pub(super) fn next(&mut self, out: &mut Piece) -> Result<bool, fmt::Error> {
        if self.is_over {
            return Ok(false);
        }
        let verb = |nth: usize| forms().nth(nth).map(|form| form.verb);
        let before = self.form.checked_sub(1).and_then(verb);
        let Some(form) = forms().nth(self.form) else {
            self.is_over = true;
            return out.write_str("]}}}}").map(|()| true);
        };
        match before {
            Some(before) if before == form.verb => out.write_str(",")?,
            before => {
                out.write_str(if before.is_some() { "]}}," } else { SCHEMA })?;
                write!(out, "\"{}\":{{\"type\":\"array\",\"items\":{{\"anyOf\":[", form.verb)?;
            }
        }
        self.form += 1;
        item(&form, out).map(|()| true)
    }
}

/// The schema of a form's objects.
fn item(form: &Form, out: &mut Piece) -> fmt::Result {
    out.write_str("{\"type\":\"object\",\"additionalProperties\":false,\"required\":[")?;
    let needed = form.columns.len() - usize::from(form.open);
    for (nth, (name, _)) in form.columns.iter().take(needed).enumerate() {
        write!(out, "{}\"{name}\"", if nth > 0 { "," } else { "" })?;
    }
    out.write_str("],\"properties\":{")?;
    let mut comma = "";
    let mut written = Ok(());
    let mut each = |name: &'static str, shape: Shape| {
        written = written.and_then(|()| {
            write!(out, "{comma}\"{name}\":")?;
            comma = ",";
            match (shape, form.kind.filter(|_| name == "kind")) {
                (_, Some(kind)) => write!(out, "{{\"const\":\"{kind}\"}}"),
                (Shape::Flag, None) => out.write_str("{\"type\":\"boolean\"}"),
                (Shape::Number(low, high), None) => {
                    write!(out, "{{\"type\":\"integer\",\"minimum\":{low},\"maximum\":{high}}}")
                }
                (Shape::Text | Shape::Quoted, None) => out.write_str("{\"type\":\"string\"}"),
            }
        });
    };
    form.columns.iter().for_each(|&(name, shape)| each(name, shape));
    form.options(&mut each);
    written?;
    out.write_str("}}")
}
