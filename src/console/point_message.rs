//! Points written by messages of publishers: as by the command `write`.

use core::fmt::{self, Write};

use embassy_time::Instant;
use heapless::String;

use super::point_ask::{Ask, Cells, parse};
use super::point_command::PointCommand;
use super::point_order::order;
use crate::gateway::Gateway;
use crate::language::{PointProblem, Problem, Words};
use crate::scanner::RowId;
use crate::settings::LINE_BYTES_MAX;

/// Why a message does not write a point.
pub(crate) type Refusal = String<112>;

/// Writes the values in `text` to the point called `name`, from value `nth` on if that is said, as the command `write` does; one text is
/// written as it is. Returns the row. [`settled`](super::point_order::settled) tells when it is done.
pub(crate) fn write_point(
    gateway: &Gateway<'_>,
    name: &str,
    nth: Option<u16>,
    text: &str,
) -> Result<RowId, Refusal> {
    let state = gateway.scanner().ok_or_else(|| said(format_args!("there are no points")))?;
    let line = line(gateway, name, nth, text)?;
    let (words, mut cells) = (Words::new(&line), Cells::new());
    let parsed = gateway.settings(|settings| parse(settings, PointCommand::Write, &words, &mut cells));
    let Ok(ask @ Ask::Put { row, .. }) = parsed else {
        let wrong = words.wrong();
        return Err(said(format_args!("\"{}\": {}", wrong.word, wrong.problem)));
    };
    let done = state.change(|scanner| order(scanner, PointCommand::Write, &ask, &cells, Instant::now()));
    done.map(|()| row).map_err(|refused| said(format_args!("{refused}")))
}

/// The words of `write` for a message.
fn line(
    gateway: &Gateway<'_>,
    name: &str,
    nth: Option<u16>,
    text: &str,
) -> Result<String<LINE_BYTES_MAX>, Refusal> {
    let is_text = gateway.settings(|settings| {
        let point = settings.points.get(usize::from(settings.find_point(name)?))?;
        Some(point.value.is_text() && (point.count == 1 || nth.is_some()))
    });
    let is_text = is_text.ok_or_else(|| {
        let problem = Problem::Points(PointProblem::NoSuchPoint);
        said(format_args!("\"{name}\": {problem}"))
    })?;
    // Programs that send lines end them.
    let text = text.trim_end_matches(['\r', '\n']);
    if text.chars().any(char::is_control) {
        return Err(said(format_args!("expected a text without control characters")));
    }
    let at = fmt::from_fn(|f| nth.map_or(Ok(()), |nth| write!(f, " at {nth}")));
    let mut line = String::new();
    let written = match is_text {
        true => write!(line, "{name}{at} \"{}\"", WithoutQuotes(text)),
        false if text.trim_ascii().is_empty() => Err(fmt::Error),
        false => write!(line, "{name}{at} {text}"),
    };
    written
        .map_err(|_| said(format_args!("expected values, at most {LINE_BYTES_MAX} bytes with the name")))?;
    Ok(line)
}

/// A text for quotes, in which `\x22` is a quote.
struct WithoutQuotes<'t>(&'t str);

impl fmt::Display for WithoutQuotes<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.split('"').enumerate().try_for_each(|(nth, part)| {
            f.write_str(if nth > 0 { "\\x22" } else { "" })?;
            f.write_str(part)
        })
    }
}

fn said(why: fmt::Arguments<'_>) -> Refusal {
    let mut refusal = Refusal::new();
    // What does not fit is cut.
    let _ = refusal.write_fmt(why);
    refusal
}
