//! The calls that run a command of the console: `scan`, `tune`, `write` of a point, `explain`; and those of versions and passwords.

use core::fmt::Write;
use core::future::pending;

use heapless::String;

use super::api::{Api, Caller};
use super::calls::{line, parse, uncommitted};
use super::json::Quoted;
use super::members::{BYTE, Kind, Line, Member, TEXT, WORD, needed, optional};
use super::response::{Content, Message, Refused, Response};
use super::routes::Call;
use super::untaken::cut;
use super::versions::Versions;
use crate::console::PASSWORD_BYTES;
use crate::console::access::{self, Denied, NotBegun, Running};
use crate::gateway::audit::Topic;
use crate::gateway::direct_request::DirectRequestError;
use crate::gateway::reconfigure;
use crate::hal::{Store, System, Update};
use crate::routing::Decision;

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
    pub(super) fn command(
        &self,
        call: Call,
        caller: &Caller,
        body: &str,
        response: &mut Response<'a, 'g>,
    ) -> Result<(), Refused> {
        let (members, verb) = match call {
            Call::Scan => (SCAN, "scan"),
            Call::Tune => (TUNE, "tune"),
            Call::Explain => (EXPLAIN, "explain"),
            _ => (POINT, "write"),
        };
        let line = line(body, members, verb, response)?;
        if call == Call::Explain {
            return self.explain(&line, response);
        }
        let who = (&caller.name, caller.role);
        let mut running = Running::new(self.gateway, self.system, who, self.peer, self.port);
        running.begin(&line).map_err(|error| match error {
            NotBegun::Line(error) => response.wrong_line(1, &line, &error),
            NotBegun::Failed => response.error(409, &failure(&running)),
        })?;
        self.gateway.web.stop.reset();
        if call == Call::Point {
            response.ok(Content::Point(running));
        } else {
            self.takes_long();
            response.ok(Content::Job(running));
        }
        Ok(())
    }

    fn explain(&self, line: &Line, response: &mut Response<'a, 'g>) -> Result<(), Refused> {
        self.gateway.settings(|settings| {
            let explained = access::explain(settings, line);
            let explained = explained.map_err(|error| response.wrong_line(1, line, &error))?;
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
            response.json(200, format_args!("{{\"outcome\":\"{outcome}\"{more},\"text\":{text}}}"));
            Ok(())
        })
    }

    /// `GET /settings/versions`
    pub(super) async fn versions(&self, response: &mut Response<'a, 'g>) {
        let mut store = self.store.lock().await;
        response.ok(Content::Versions(Versions::of(*store)));
    }

    /// `POST /settings/versions`
    pub(super) async fn bring_back(
        &self,
        caller: &Caller,
        body: &str,
        response: &mut Response<'a, 'g>,
    ) -> Result<(), Refused> {
        let version = parse(body, VERSION, response)?.number("version").unwrap_or_default();
        let candidate = self.candidate(response)?;
        self.gateway.audit(Topic::Command, self.actor(caller), format_args!("rollback {version}"));
        let mut store = self.store.lock().await;
        let done = candidate.bring_back(self.gateway, *store, version as usize).await;
        done.map_err(|error| uncommitted(&error, response))
    }

    /// `POST /password`: sets it, and saves the settings.
    pub(super) async fn password(
        &self,
        caller: &Caller,
        body: &str,
        response: &mut Response<'a, 'g>,
    ) -> Result<(), Refused> {
        let (name, password) =
            parse(body, PASSWORD, response).map(|members| (members.user(), members.password()))?;
        if !PASSWORD_BYTES.contains(&password.len()) || password.chars().any(char::is_control) {
            return Err(response.error(422, &Denied::Length));
        }
        let gateway = self.gateway;
        let name = name.filter(|name| gateway.settings(|settings| settings.user(name).is_some()));
        let name = name.ok_or_else(|| response.error(422, &"there is no such user"))?;
        let hash = self.system.hash_password(&password).await;
        let hash = hash.ok_or_else(|| response.error(409, &Denied::NoHash))?;
        let set = reconfigure::set_password(gateway, &name, hash).await;
        set.map_err(|error| response.error(409, &error))?;
        gateway.audit(Topic::Settings, self.actor(caller), format_args!("password {name}"));
        let mut store = self.store.lock().await;
        gateway.sign(*store, self.actor(caller));
        let saved = reconfigure::save(gateway, *store, false).await;
        saved.map_err(|error| response.error(409, &error))
    }
}

/// What the command says of its failure.
fn failure(running: &Running<'_, '_>) -> Message {
    let text = running.text().trim();
    cut(text.strip_prefix("error: ").unwrap_or(text))
}

impl Response<'_, '_> {
    /// Does what must be over before the status can be told.
    pub(super) async fn settle(&mut self) -> Result<(), Refused> {
        match &mut self.content {
            Content::Values(asked, _) => match asked.ask().await {
                Ok(()) => {}
                Err(DirectRequestError::Broadcast) => self.json(200, format_args!("{{\"unit\":0}}")),
                Err(error) => return Err(self.error(409, &error)),
            },
            Content::Point(running) => {
                while running.next(pending).await {
                    if running.has_failed() {
                        let failure = failure(running);
                        return Err(self.error(409, &failure));
                    }
                }
                *self = Self::new();
            }
            _ => {}
        }
        Ok(())
    }
}
