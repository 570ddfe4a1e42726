//! The response to a request: a status, and a short text or a stream of pieces, which are produced while they are sent.

use core::fmt::{self, Display, Write as _};

use embassy_futures::yield_now;
use embassy_time::{Duration, Timer};
use heapless::{String, Vec};
use picoserve::ResponseSent;
use picoserve::io::{Read, Write};
use picoserve::response::chunked::{ChunkWriter, ChunkedResponse, Chunks, ChunksWritten};
use picoserve::response::{self, Connection, IntoResponse, ResponseWriter, StatusCode};

use super::frames;
use super::headers::{FILE_HEADERS, HEADERS, HEADERS_MAX, Header};
use super::job;
use super::json::Quoted;
use super::metrics::Metrics;
use super::page::File;
use super::piece::{Piece, ShortPiece, Source, TEXT_BYTES_MAX, Text};
use super::session;
use super::settings::{Schema, Written};
use super::status::Status;
use super::untaken::cut;
use super::versions::Versions;
use crate::console::access::{Asked, Running};
use crate::console::diff::restarting;
use crate::gateway::Gateway;
use crate::gateway::difference::Difference;
use crate::gateway::web::{Hold, Token};
use crate::language::LineError;

/// A message, which is cut if it is longer.
pub(super) type Message = String<{ TEXT_BYTES_MAX / 4 }>;

/// Time between two events of live values.
const LIVE_PAUSE: Duration = Duration::from_secs(1);

const TEXT: &str = "text/plain; charset=utf-8";
const PAGES_FULL: &str =
    "four pages have live values, and more cannot: close one, or GET /api/v1/status now and then";
const CAPTURES_FULL: &str = "two others get frames, and more cannot: stop one of them";

/// The response to a request. It is made where it stays: it is large, and there is no heap.
pub(super) struct Response<'s, 'g> {
    status: u16,
    pub(super) header: Option<Header>,
    pub(super) content: Content<'s, 'g>,
}

// One at a time.
#[allow(clippy::large_enum_variant)]
pub(super) enum Content<'s, 'g> {
    Nothing,
    Json(Text),
    /// A file of the page, which its browser has or not.
    File(&'static File, bool),
    Status(Status),
    /// The status as events, until the session ends.
    Live(Status, Token),
    Settings(Written),
    Schema(Schema),
    Versions(Versions),
    Diff(Difference, Part),
    /// The response of a unit.
    Values(Asked<'s, 'g>, Part),
    /// A point that is being written.
    Point(Running<'s, 'g>),
    /// What a command writes.
    Job(Running<'s, 'g>),
    /// Frames as they come, until the session ends.
    Frames(Token),
    Metrics(Metrics),
}

/// The response tells why.
#[derive(Debug)]
pub(super) struct Refused;

/// How far an object has been written.
#[derive(Default, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    #[default]
    Head,
    First,
    More,
    /// The next rule, and whether one was told.
    Rule(usize, bool),
    Over,
}

impl<'s, 'g> Response<'s, 'g> {
    /// Done, without content.
    pub(super) fn new() -> Self {
        Self { status: 204, header: None, content: Content::Nothing }
    }

    /// Responds with `content`.
    pub(super) fn ok(&mut self, content: Content<'s, 'g>) {
        (self.status, self.content) = (200, content);
    }

    /// Responds with a file, unless the browser has it.
    pub(super) fn file(&mut self, file: &'static File, is_known: bool) {
        (self.status, self.content) = (if is_known { 304 } else { 200 }, Content::File(file, is_known));
    }

    /// Responds with a short object.
    pub(super) fn json(&mut self, status: u16, json: fmt::Arguments<'_>) {
        (self.status, self.content) = (status, Content::Json(Text::new()));
        if let Content::Json(text) = &mut self.content {
            // Sized for what is written.
            let _ = text.write_fmt(json);
        }
    }

    /// Responds with an error and its message.
    pub(super) fn error(&mut self, status: u16, what: &dyn Display) -> Refused {
        let mut message = Message::new();
        // See `Message`.
        let _ = write!(message, "{what}");
        self.json(status, format_args!("{{\"error\":{{\"message\":{}}}}}", Quoted(message)));
        Refused
    }

    /// Responds with an error in line `number` of a text, or in the line that was made of a request.
    pub(super) fn wrong_line(&mut self, number: usize, line: &str, error: &LineError) -> Refused {
        let mut message = Message::new();
        // See `Message`.
        let _ = write!(message, "{error}");
        let text: Message = cut(line);
        self.json(
            422,
            format_args!(
                "{{\"error\":{{\"message\":{},\"line\":{number},\"column\":{},\"word\":{},\"text\":{}}}}}",
                Quoted(message),
                error.column,
                Quoted(&error.word),
                Quoted(text)
            ),
        );
        Refused
    }

    /// Sends it.
    pub(super) async fn send<R: Read, W: ResponseWriter<Error = R::Error>>(
        &mut self,
        source: Source<'_, '_>,
        connection: Connection<'_, R>,
        writer: W,
    ) -> Result<ResponseSent, W::Error> {
        let hold = match self.content {
            Content::Live(..) => Some((Hold::Events, PAGES_FULL)),
            Content::Frames(_) => Some((Hold::Frames, CAPTURES_FULL)),
            _ => None,
        };
        let held = hold.map(|(hold, full)| source.gateway.web.hold(hold).ok_or(full));
        if let Some(Err(full)) = held {
            self.error(409, &full);
        }
        let Self { status, header, content } = self;
        let status = StatusCode::new(*status);
        let mut headers = Vec::<(&str, &dyn Display), HEADERS_MAX>::new();
        let mut push = |name, value| {
            // There is room for all of them.
            let _ = headers.push((name, value));
        };
        let always = if matches!(content, Content::File(..)) { FILE_HEADERS } else { HEADERS };
        always.iter().for_each(|(name, value)| push(name, value));
        if let Content::File(file, _) = content {
            push("ETag", &file.tag);
        }
        if let Some(header) = header {
            push(header.name(), header);
        }
        if matches!(content, Content::Nothing | Content::File(_, true)) {
            let response = response::Response::empty(status).with_headers(&*headers);
            return response.write_to(connection, writer).await;
        }
        let response = ChunkedResponse::new(Pieces { source, content }).into_response();
        let response = response.with_status_code(status).with_headers(&*headers);
        response.write_to(connection, writer).await
    }
}

/// A stream of pieces.
struct Pieces<'a, 'b, 's, 'g> {
    source: Source<'a, 'b>,
    content: &'a mut Content<'s, 'g>,
}

impl Chunks for Pieces<'_, '_, '_, '_> {
    fn content_type(&self) -> &'static str {
        match *self.content {
            Content::File(file, _) => file.kind,
            Content::Settings(ref written) if !written.is_json() => TEXT,
            Content::Job(_) => TEXT,
            Content::Frames(_) => "application/x-pcapng",
            Content::Live(..) => "text/event-stream",
            Content::Metrics(ref metrics) => metrics.content_type(),
            _ => "application/json",
        }
    }

    async fn write_chunks<W: Write>(self, mut writer: ChunkWriter<W>) -> Result<ChunksWritten, W::Error> {
        let Self { source, content } = self;
        match content {
            Content::Json(text) => writer.write_chunk(text.as_bytes()).await?,
            Content::File(file, _) => writer.write_chunk(file.bytes).await?,
            Content::Job(running) => job::run(&source, running, &mut writer).await?,
            Content::Frames(token) => frames::send(&source, token, &mut writer).await?,
            _ => {}
        }
        loop {
            while content.write_next(&source, &mut writer).await? {}
            let Content::Live(status, token) = content else { break };
            Timer::after(LIVE_PAUSE).await;
            // Live values do not prolong the session.
            if session::user(source.gateway, token, false).is_none() {
                break;
            }
            *status = Status::new();
        }
        writer.finalize().await
    }
}

impl Content<'_, '_> {
    /// Sends the next pieces, as many as fit into one chunk; `false`: there are no more.
    async fn write_next<W: Write>(
        &mut self,
        source: &Source<'_, '_>,
        writer: &mut ChunkWriter<W>,
    ) -> Result<bool, W::Error> {
        let mut short = ShortPiece::new();
        let mut more = loop {
            let before = short.len();
            match self.next(source, &mut short) {
                // Lets other tasks run between two rows.
                Ok(true) => yield_now().await,
                Ok(false) => break false,
                Err(_) => {
                    short.truncate(before);
                    break true;
                }
            }
        };
        let mut held = None;
        let piece = if more && short.is_empty() {
            let long = held.insert(source.gateway.web.long_piece.lock().await);
            long.clear();
            // A piece that does not fit here either ends the response, which its receiver finds incomplete.
            more = self.next(source, long.as_mut_view()) == Ok(true);
            if more { long.as_bytes() } else { b"" }
        } else {
            short.as_bytes()
        };
        writer.write_chunk(piece).await?;
        Ok(more)
    }

    /// Writes the next piece; `false`: there was none. After an error the same piece is the next one.
    pub(super) fn next(&mut self, source: &Source<'_, '_>, out: &mut Piece) -> Result<bool, fmt::Error> {
        match self {
            Self::Nothing
            | Self::Json(_)
            | Self::File(..)
            | Self::Point(_)
            | Self::Job(_)
            | Self::Frames(_) => Ok(false),
            Self::Status(status) => retried(status, |status| status.next(source, out)),
            Self::Live(status, ..) => retried(status, |status| {
                // An event is a line: in JSON, line ends are escaped.
                out.write_str(if status.is_new() { "data: " } else { "" })?;
                let more = status.next(source, out)?;
                out.write_str(if more && status.has_just_ended() { "\n\n" } else { "" }).map(|()| more)
            }),
            Self::Settings(written) => retried(written, |written| written.next(source.gateway, out)),
            Self::Schema(schema) => retried(schema, |schema| schema.next(out)),
            Self::Versions(versions) => versions.next(out),
            Self::Metrics(metrics) => retried(metrics, |metrics| metrics.next(source, out)),
            Self::Diff(diff, part) => next_of_diff(source.gateway, diff, part, out),
            Self::Values(response, part) => {
                if *part == Part::Over {
                    return Ok(false);
                }
                values(response, out)?;
                *part = Part::Over;
                Ok(true)
            }
        }
    }
}

/// Writes the next piece of `source`, which stays as it was after an error.
fn retried<T: Clone, E>(source: &mut T, next: impl FnOnce(&mut T) -> Result<bool, E>) -> Result<bool, E> {
    let mut ahead = source.clone();
    let is_one = next(&mut ahead)?;
    *source = ahead;
    Ok(is_one)
}

/// `{"lines":["- ...","+ ..."],"restarts":["P1"],"rules":[{"rule":2,"message":"never matches ..."}]}`
fn next_of_diff(
    gateway: &Gateway<'_>,
    diff: &mut Difference,
    part: &mut Part,
    out: &mut Piece,
) -> Result<bool, fmt::Error> {
    let separator = match part {
        Part::Head => {
            out.write_str("{\"lines\":[")?;
            *part = Part::First;
            return Ok(true);
        }
        Part::First => "",
        Part::More => ",",
        Part::Rule(nth, is_one) => return next_of_rules(gateway, (*nth, *is_one), part, out),
        Part::Over => return Ok(false),
    };
    // The candidate may be gone since the check; then nothing differs.
    let candidate = gateway.candidate().and_then(|candidate| candidate.settings().ok());
    let mut ahead = diff.clone();
    let next = candidate.as_ref().and_then(|new| gateway.settings(|in_force| ahead.next(in_force, new)));
    if let Some((sign, line)) = next {
        write!(out, "{separator}{}", Quoted(format_args!("{sign} {line}")))?;
        (*diff, *part) = (ahead, Part::More);
        return Ok(true);
    }
    out.write_str("],\"restarts\":[")?;
    if let Some(new) = &candidate {
        gateway.settings(|in_force| {
            restarting(in_force, new)
                .enumerate()
                .try_for_each(|(nth, name)| write!(out, "{}{}", if nth > 0 { "," } else { "" }, Quoted(name)))
        })?;
    }
    out.write_str("],\"rules\":[")?;
    *part = Part::Rule(0, false);
    Ok(true)
}

/// The next rule of the candidate that is likely a mistake, from rule `nth` on.
fn next_of_rules(
    gateway: &Gateway<'_>,
    (nth, is_one): (usize, bool),
    part: &mut Part,
    out: &mut Piece,
) -> Result<bool, fmt::Error> {
    let candidate = gateway.candidate().and_then(|candidate| candidate.settings().ok());
    let mut rules = candidate.iter().flat_map(|new| {
        (nth..new.routes.len()).filter_map(|at| new.rule_warning(at).map(|warning| (at, warning)))
    });
    let Some((at, warning)) = rules.next() else {
        out.write_str("]}")?;
        *part = Part::Over;
        return Ok(true);
    };
    let comma = if is_one { "," } else { "" };
    write!(out, "{comma}{{\"rule\":{},\"message\":{}}}", at + 1, Quoted(warning))?;
    *part = Part::Rule(at + 1, true);
    Ok(true)
}

/// `{"unit":7,"took_us":1234,"address":0,"values":[1,2]}`
fn values(response: &Asked<'_, '_>, out: &mut Piece) -> fmt::Result {
    write!(out, "{{\"unit\":{},\"took_us\":{}", response.unit(), response.took.as_micros())?;
    match (response.exception(), response.values()) {
        (Some(exception), _) => {
            let (code, text) = (exception.0, Quoted(exception));
            write!(out, ",\"exception\":{{\"code\":{code},\"message\":{text}}}}}")
        }
        (None, Some((address, values))) => write!(out, ",\"address\":{address},\"values\":{values}}}"),
        (None, None) => out.write_str("}"),
    }
}
