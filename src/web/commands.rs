//! The calls that run a command of the console: `scan`, `tune`, `write` of a point, `explain`; and those of versions and passwords.

use core::fmt::Write;
use core::future::pending;

use heapless::String;

use super::api::{Api, Call, Caller};
use super::calls::{line, parse, uncommitted};
use super::json::Quoted;
use super::members::{BYTE, Kind, Line, Member, TEXT, WORD, needed, optional};
use super::response::{Content, Response, Text};
use crate::console::access::{self, Denied, NotBegun, Running};
use crate::gateway::audit::Topic;
use crate::gateway::commit::Uncommitted;
use crate::gateway::direct_request::DirectRequestError;
use crate::gateway::reconfigure;
use crate::hal::{Store, System, Update};
use crate::routing::Decision;

/// Fits what a store tells of a version.
const VERSION_BYTES_MAX: usize = 128;
/// Bytes of a password: as at consoles.
const PASSWORD_BYTES: core::ops::RangeInclusive<usize> = 8..=64;

const SCAN: &[Member] = &[
    needed("port", Kind::Word),
    optional("bauds", Kind::Numbers, ""),
    optional("units", Kind::Range, "units "),
    optional("function", BYTE, "function "),
    optional("timeout_ms", Kind::Millis, "timeout "),
];
const TUNE: &[Member] = &[
    needed("port", Kind::Word),
    optional("units", Kind::Range, "units "),
    optional("count", Kind::Number(u32::MAX), "count "),
];
const EXPLAIN: &[Member] = &[
    needed("port", Kind::Word),
    needed("unit", BYTE),
    needed("function", BYTE),
    optional("address", WORD, ""),
    optional("count", WORD, ""),
    optional("from", Kind::Address, "from "),
    optional("role", Kind::Role, "role "),
];
const POINT: &[Member] = &[
    needed("point", Kind::Point),
    optional("at", WORD, "at "),
    optional("values", Kind::Numbers, ""),
    // One value as it is typed: text, or a number of more digits than a float has.
    #[cfg(feature = "long-values")] // As such values.
    optional("text", Kind::Quoted, ""),
];
const VERSION: &[Member] = &[needed("version", BYTE)];
const PASSWORD: &[Member] = &[needed("user", TEXT), needed("password", TEXT)];

impl<'a, 'g, S: Store, U: Update, Y: System> Api<'a, 'g, S, U, Y> {
    /// `scan`, `tune`, `explain`, and the `write` of a point, which have begun.
    pub(super) fn command(&self, call: Call, caller: &Caller, body: &str) -> Response<'a, 'g> {
        let (members, verb) = match call {
            Call::Scan => (SCAN, "scan"),
            Call::Tune => (TUNE, "tune"),
            Call::Explain => (EXPLAIN, "explain"),
            _ => (POINT, "write"),
        };
        let line = match line(body, members, verb) {
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
        if call == Call::Point {
            return Response::ok(Content::Point(running));
        }
        self.takes_long();
        Response::ok(Content::Job(running))
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
        let version = match parse(body, VERSION) {
            Ok(members) => members.number("version").unwrap_or_default(),
            Err(refusal) => return refusal,
        };
        let Some(candidate) = self.gateway.candidate() else { return uncommitted(&Uncommitted::Nothing) };
        self.gateway.audit(Topic::Command, caller.actor(), format_args!("rollback {version}"));
        let mut store = self.store.lock().await;
        match candidate.bring_back(self.gateway, *store, version as usize).await {
            Ok(()) => Response::done(),
            Err(error) => uncommitted(&error),
        }
    }

    /// `POST /password`: sets it, and saves the settings.
    pub(super) async fn password(&self, caller: &Caller, body: &str) -> Response<'a, 'g> {
        let (name, password) = match parse(body, PASSWORD) {
            Ok(members) => (members.user(), members.password()),
            Err(refusal) => return refusal,
        };
        if !PASSWORD_BYTES.contains(&password.len()) || password.chars().any(char::is_control) {
            return Response::error(422, &"a password has 8 to 64 characters");
        }
        let gateway = self.gateway;
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
pub(super) fn failed<'s, 'g>(running: &Running<'_, '_>) -> Response<'s, 'g> {
    let text = running.text().trim();
    Response::error(409, &text.strip_prefix("error: ").unwrap_or(text))
}

impl Response<'_, '_> {
    /// Does what must be over before the status can be told. It is done in place, so that there is one response in memory.
    pub(super) async fn settle(&mut self) {
        match &mut self.content {
            Content::Values(asked, _) => match asked.ask().await {
                Ok(()) => {}
                Err(DirectRequestError::Broadcast) => *self = Self::json(200, format_args!("{{\"unit\":0}}")),
                Err(error) => *self = Self::error(409, &error),
            },
            Content::Point(running) => {
                while running.next(pending).await {
                    if running.has_failed() {
                        *self = failed(running);
                        return;
                    }
                }
                *self = Self::done();
            }
            _ => {}
        }
    }
}
