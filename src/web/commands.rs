//! The calls that run a command of the console: `scan`, `tune`, `write` of a point, `explain`; and those of versions and passwords.

use core::fmt::Write;

use heapless::{String, Vec};
use serde::Deserialize;

use super::api::{Api, Call, Caller};
use super::calls::{Line, VALUES_MAX, Word, parse, uncommitted, words};
use super::json::Quoted;
use super::response::{Content, Response, Text};
use crate::console::access::{self, Denied, NotBegun, Running};
use crate::gateway::audit::Topic;
use crate::gateway::commit::Uncommitted;
use crate::gateway::reconfigure;
use crate::hal::{Store, System, Update};
use crate::routing::Decision;
use crate::settings::{ClientRole, Name};

/// Fits what a store tells of a version.
const VERSION_BYTES_MAX: usize = 128;
/// Fits a text in which each character is escaped but for some.
#[cfg(feature = "long-values")] // As texts.
const TEXT_BYTES_MAX: usize = 256;
/// Bytes of a password: as at consoles.
const PASSWORD_BYTES: core::ops::RangeInclusive<usize> = 8..=64;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Scan {
    port: Word,
    units: Option<Word>,
    bauds: Option<Vec<u32, 8>>,
    timeout_ms: Option<u32>,
    function: Option<u8>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Tune {
    port: Word,
    units: Option<Word>,
    count: Option<u32>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Explain {
    port: Word,
    unit: u8,
    function: u8,
    address: Option<u16>,
    count: Option<u16>,
    from: Option<String<48>>,
    role: Option<String<31>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Point {
    point: Word,
    at: Option<u16>,
    #[serde(default)]
    values: Vec<f64, VALUES_MAX>,
    /// One value as it is typed: text, or a number of more digits than a float has.
    #[cfg(feature = "long-values")] // As such values.
    text: Option<String<TEXT_BYTES_MAX>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Version {
    version: u8,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Password {
    user: String<64>,
    password: String<64>,
}

impl Scan {
    fn line(&self) -> Option<Line> {
        let Self { port, units, bauds, timeout_ms, function } = self;
        let mut line = words("scan", &[Some(port)])?;
        bauds.iter().flatten().try_for_each(|baud| write!(line, " {baud}")).ok()?;
        optional(&mut line, "units", units.as_ref().filter(|units| is_range(units)), units.is_some())?;
        optional(&mut line, "function", function.as_ref(), false)?;
        timeout_ms.iter().try_for_each(|time| write!(line, " timeout {time}ms")).ok()?;
        Some(line)
    }
}

impl Tune {
    fn line(&self) -> Option<Line> {
        let Self { port, units, count } = self;
        let mut line = words("tune", &[Some(port)])?;
        optional(&mut line, "units", units.as_ref().filter(|units| is_range(units)), units.is_some())?;
        optional(&mut line, "count", count.as_ref(), false)?;
        Some(line)
    }
}

impl Explain {
    fn line(&self) -> Option<Line> {
        let Self { port, unit, function, address, count, from, role } = self;
        let mut line = words("explain", &[Some(port)])?;
        write!(line, " {unit} {function}").ok()?;
        if address.is_some() || count.is_some() {
            write!(line, " {}", address.unwrap_or(0)).ok()?;
        }
        count.iter().try_for_each(|count| write!(line, " {count}")).ok()?;
        let is_address = |from: &&String<48>| from.parse::<core::net::IpAddr>().is_ok();
        optional(&mut line, "from", from.as_ref().filter(is_address), from.is_some())?;
        let is_role = |role: &&String<31>| ClientRole::new(role).is_some();
        optional(&mut line, "role", role.as_ref().filter(is_role), role.is_some())?;
        Some(line)
    }
}

impl Point {
    fn line(&self) -> Option<Line> {
        let mut line = words("write", &[Some(&self.point)])?;
        // A number would be a unit.
        self.point.bytes().next().filter(u8::is_ascii_alphabetic)?;
        optional(&mut line, "at", self.at.as_ref(), false)?;
        self.values.iter().try_for_each(|value| write!(line, " {value}")).ok()?;
        #[cfg(feature = "long-values")] // As the field.
        if let Some(text) = &self.text {
            let is_word = !text.contains(|letter: char| letter == '"' || letter.is_control());
            is_word.then(|| write!(line, " \"{text}\"").ok())??;
            return self.values.is_empty().then_some(line);
        }
        (!self.values.is_empty()).then_some(line)
    }
}

/// Appends a word with its value, if there is one; `None` if one is `needed`.
fn optional<T: core::fmt::Display>(
    line: &mut Line,
    word: &str,
    value: Option<T>,
    needed: bool,
) -> Option<()> {
    match value {
        Some(value) => write!(line, " {word} {value}").ok(),
        None => (!needed).then_some(()),
    }
}

fn is_range(word: &Word) -> bool {
    word.bytes().all(|byte| byte.is_ascii_digit() || byte == b'-')
}

/// The body has fields that are not words of a line, or too many.
fn no_line<'s, 'g>() -> Response<'s, 'g> {
    Response::error(422, &"port, units, point and from are one word each, and a point has values or a text")
}

impl<'a, 'g, S: Store, U: Update, Y: System> Api<'a, 'g, S, U, Y> {
    pub(super) async fn command(&self, call: Call, caller: &Caller, body: &str) -> Response<'a, 'g> {
        let line = match call {
            Call::Scan => parse(body).map(|scan: Scan| scan.line()),
            Call::Tune => parse(body).map(|tune: Tune| tune.line()),
            Call::Explain => parse(body).map(|explain: Explain| explain.line()),
            _ => parse(body).map(|point: Point| point.line()),
        };
        let line = match line.and_then(|line| line.ok_or_else(no_line)) {
            Ok(line) => line,
            Err(refusal) => return refusal,
        };
        if call == Call::Explain {
            return self.explain(&line);
        }
        let who = (&caller.name, caller.role);
        let mut running = Running::new(self.gateway, self.system, who, self.peer, self.port);
        match running.begin(&line) {
            Ok(()) => {}
            Err(NotBegun::Line(error)) => return Response::wrong_line(None, &line, &error),
            Err(NotBegun::Failed) => return failed(&running),
        }
        self.gateway.web.stop.reset();
        if matches!(call, Call::Scan | Call::Tune) {
            self.takes_long();
            return Response::ok(Content::Job(running));
        }
        while running.next(core::future::pending).await {
            if running.has_failed() {
                return failed(&running);
            }
        }
        Response::done()
    }

    fn explain(&self, line: &Line) -> Response<'a, 'g> {
        self.gateway.settings(|settings| {
            let explained = match access::explain(settings, line) {
                Ok(explained) => explained,
                Err(error) => return Response::wrong_line(None, line, &error),
            };
            let mut more = String::<128>::new();
            let (outcome, written) = match explained.decision {
                Decision::Forward { port, unit, .. } => {
                    ("forward", write!(more, ",\"port\":{},\"unit\":{unit}", Quoted(settings.name(port))))
                }
                Decision::Local => ("local", Ok(())),
                Decision::Discard => ("discard", Ok(())),
                Decision::Refuse(exception) => ("refuse", write!(more, ",\"exception\":{}", exception.0)),
                Decision::Ignore { .. } => ("confirm", Ok(())),
                Decision::AllLines => ("all-lines", Ok(())),
                Decision::NoRule => ("no-rule", Ok(())),
            };
            let rule = explained.rule.map(|nth| nth + 1);
            let rule = rule.into_iter().try_for_each(|rule| write!(more, ",\"rule\":{rule}"));
            // Sized for what is written.
            let _ = written.and(rule);
            let text = Quoted(explained.text(settings));
            Response::json(200, format_args!("{{\"outcome\":\"{outcome}\"{more},\"text\":{text}}}"))
        })
    }

    /// `GET /settings/versions`
    pub(super) async fn versions(&self) -> Response<'a, 'g> {
        let mut store = self.store.lock().await;
        let mut json = Text::new();
        for nth in 0.. {
            let mut known = String::<VERSION_BYTES_MAX>::new();
            // What does not fit is cut.
            if store.write_version(nth, &mut known).is_none() {
                break;
            }
            let mut cells = known.splitn(3, '\t');
            let [time, lines, who] = [(); 3].map(|()| Quoted(cells.next().unwrap_or_default()));
            let (length, comma) = (json.len(), if nth > 0 { "," } else { "" });
            let row =
                format_args!("{comma}{{\"version\":{nth},\"time\":{time},\"lines\":{lines},\"who\":{who}}}");
            if json.write_fmt(row).is_err() {
                json.truncate(length);
                break;
            }
        }
        Response::json(200, format_args!("{{\"versions\":[{json}]}}"))
    }

    /// `POST /settings/versions`
    pub(super) async fn bring_back(&self, caller: &Caller, body: &str) -> Response<'a, 'g> {
        let Version { version } = match parse(body) {
            Ok(version) => version,
            Err(refusal) => return refusal,
        };
        let Some(candidate) = self.gateway.candidate() else { return uncommitted(&Uncommitted::Nothing) };
        self.gateway.audit(Topic::Command, caller.actor(), format_args!("rollback {version}"));
        let mut store = self.store.lock().await;
        match candidate.bring_back(self.gateway, *store, version.into()).await {
            Ok(()) => Response::done(),
            Err(error) => uncommitted(&error),
        }
    }

    /// `POST /password`: sets it, and saves the settings.
    pub(super) async fn password(&self, caller: &Caller, body: &str) -> Response<'a, 'g> {
        let Password { user, password } = match parse(body) {
            Ok(password) => password,
            Err(refusal) => return refusal,
        };
        if !PASSWORD_BYTES.contains(&password.len()) || password.chars().any(char::is_control) {
            return Response::error(422, &"a password has 8 to 64 characters");
        }
        let gateway = self.gateway;
        let name = Name::try_from(user.as_str()).ok();
        let Some(name) = name.filter(|name| gateway.settings(|settings| settings.user(name).is_some()))
        else {
            return Response::error(422, &"there is no such user");
        };
        let Some(hash) = self.system.hash_password(&password).await else {
            return Response::error(409, &Denied::NoHash);
        };
        if let Err(error) = reconfigure::set_password(gateway, &name, hash).await {
            return Response::error(409, &error);
        }
        gateway.audit(Topic::Settings, caller.actor(), format_args!("password {name}"));
        let mut store = self.store.lock().await;
        store.sign(&caller.actor());
        match reconfigure::save(gateway, *store, false).await {
            Ok(()) => Response::done(),
            Err(error) => Response::error(409, &error),
        }
    }
}

/// What the command says of its failure.
fn failed<'s, 'g>(running: &Running<'_, '_>) -> Response<'s, 'g> {
    let text = running.text().trim();
    Response::error(409, &text.strip_prefix("error: ").unwrap_or(text))
}
