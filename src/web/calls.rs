//! What the calls do.

use core::fmt::Write;

use embassy_time::{Duration, Instant};
use heapless::String;

use super::api::{Api, Caller};
use super::candidate::{self, Unchanged};
use super::headers::Header;
use super::json::Quoted;
use super::lines::Lines;
use super::members::{BYTE, Kind, Line, Member, Members, TEXT, WORD, needed, optional, via};
use super::piece::TEXT_BYTES_MAX;
use super::response::{Content, Part, Refused, Response};
use super::routes::Call;
use super::session::Shown;
use super::settings::{Schema, Written};
use super::status::Status;
use super::untaken::Untaken;
use crate::console::access::{self, Ask, Asked, Denied, NotAsked};
use crate::gateway::audit::{Topic, Way};
use crate::gateway::commit::Uncommitted;
use crate::gateway::difference::Difference;
use crate::gateway::enter::Refused as NotEntered;
use crate::gateway::web::Token;
use crate::gateway::{ApplyError, Candidate, Credential};
use crate::hal::{Store, System, Update};

/// With `token` it is told, and no cookie is set.
const LOG_IN: &[Member] =
    &[needed("user", TEXT), needed("password", TEXT), optional("token", Kind::Flag, "")];
/// `confirmed` in seconds.
const COMMIT: &[Member] =
    &[optional("check", Kind::Flag, ""), optional("confirmed", Kind::Number(u32::MAX), "")];
const DIRECT: &[Member] = &[
    needed("unit", BYTE),
    optional("table", Kind::Word, ""),
    optional("address", WORD, ""),
    optional("count", WORD, "count "),
    optional("type", Kind::Word, "as "),
    optional("order", Kind::Word, "order "),
    optional("values", Kind::Numbers, ""),
    via("port"),
];

/// Reads a body of these members.
pub(super) fn parse(
    body: &str,
    members: &'static [Member],
    response: &mut Response<'_, '_>,
) -> Result<Members, Refused> {
    Members::read(body, members).map_err(|error| untaken(&error, response))
}

/// Reads a body of these members as the line of a verb.
pub(super) fn line(
    body: &str,
    members: &'static [Member],
    verb: &str,
    response: &mut Response<'_, '_>,
) -> Result<Line, Refused> {
    parse(body, members, response)?.line(verb).map_err(|error| untaken(&error, response))
}

fn untaken(error: &Untaken, response: &mut Response<'_, '_>) -> Refused {
    match error {
        Untaken::Line(number, line, error) => response.wrong_line(*number, line, error),
        Untaken::NotAWord(_) | Untaken::TooLong => response.error(422, error),
        #[cfg(feature = "long-values")] // As the error.
        Untaken::NoValue => response.error(422, error),
        _ => response.error(400, error),
    }
}

pub(super) fn uncommitted(error: &Uncommitted, response: &mut Response<'_, '_>) -> Refused {
    response.error(if matches!(error, Uncommitted::Apply(_)) { 422 } else { 409 }, error)
}

impl<'a, 'g, S: Store, U: Update, Y: System> Api<'a, 'g, S, U, Y> {
    /// Without content, the response is that it was done.
    pub(super) async fn run(
        &self,
        call: Call,
        caller: &Caller,
        body: &str,
        response: &mut Response<'a, 'g>,
    ) -> Result<(), Refused> {
        match call {
            // The first two need no session, and an image is processed as it arrives.
            Call::LogIn | Call::Metrics | Call::Update => {}
            Call::Session => {
                let (user, role) = (Quoted(&caller.name), caller.role);
                response.json(200, format_args!("{{\"user\":{user},\"role\":\"{role}\"}}"));
            }
            Call::LogOut => {
                self.gateway.web.end(&caller.token);
                response.header = Some(Header::Cookie(None, self.terms.encrypted));
            }
            Call::Status => response.ok(Content::Status(Status::new())),
            Call::Events => response.ok(Content::Live(Status::new(), caller.token)),
            Call::Tables(tables) => response.ok(Content::Status(Status::of(tables))),
            Call::Frames => return self.frames(caller, response),
            Call::Settings(as_json) => response.ok(Content::Settings(Written::new(false, as_json))),
            Call::Candidate(as_json) => {
                self.check_candidate(response)?;
                response.ok(Content::Settings(Written::new(true, as_json)));
            }
            Call::Schema => response.ok(Content::Schema(Schema::default())),
            Call::Diff => {
                self.check_candidate(response)?;
                response.ok(Content::Diff(Difference::default(), Part::default()));
            }
            Call::Replace | Call::Change => {
                return self.change(Lines::Text(body), call == Call::Replace, response).await;
            }
            Call::ReplaceJson | Call::ChangeJson => {
                return self.change(Lines::Json(body), call == Call::ReplaceJson, response).await;
            }
            Call::Discard => {
                self.candidate(response)?.discard().map_err(|error| uncommitted(&error, response))?
            }
            Call::Commit => return self.commit(caller, body, response).await,
            Call::Confirm => return self.confirm(caller, response).await,
            Call::RollBack => return self.roll_back(caller, response).await,
            Call::Direct(ask) => return self.ask(caller, ask, body, response),
            Call::Scan | Call::Tune | Call::Explain | Call::Point => {
                return self.command(call, caller, body, response);
            }
            Call::Stop => self.gateway.web.stop.signal(()),
            Call::Firmware => self.firmware(response),
            Call::GoBack => return self.go_back(caller, response),
            Call::Versions => self.versions(response).await,
            Call::BringBack => return self.bring_back(caller, body, response).await,
            Call::Password => return self.password(caller, body, response).await,
        }
        Ok(())
    }

    /// `GET /frames`
    fn frames(&self, caller: &Caller, response: &mut Response<'a, 'g>) -> Result<(), Refused> {
        if self.gateway.capture().is_none() {
            return Err(response.error(409, &ApplyError::NoCapture));
        }
        self.takes_long();
        response.ok(Content::Frames(caller.token));
        Ok(())
    }

    /// `POST /session`
    pub(super) async fn log_in(&self, body: &str, response: &mut Response<'a, 'g>) -> Result<(), Refused> {
        let (name, password, is_told) = parse(body, LOG_IN, response).map(|members| {
            // No user has a longer name.
            (members.user().unwrap_or_default(), members.password(), members.is_set("token"))
        })?;
        let gateway = self.gateway;
        let _one_at_a_time = gateway.web.log_in.lock().await;
        let user = match gateway.enter(self.system, self.peer, &name, Credential::Password(&password)).await {
            Ok(user) => user,
            Err(NotEntered::Pause(pause)) => {
                response.header = Some(Header::RetryAfter(pause));
                return Err(response.error(429, &Denied::Pause(pause)));
            }
            Err(NotEntered::Wrong) => return Err(response.error(401, &Denied::Wrong)),
        };
        let (role, now, mut token) = (user.role, Instant::now(), Token::default());
        // A log-in by password implies one.
        let password = user.password.unwrap_or_default();
        if !self.system.random(&mut token) {
            return Err(response.error(403, &Denied::NoHash));
        }
        let end = gateway.web.begin(token, name.clone(), password, now);
        let expires = end.saturating_duration_since(now).as_secs();
        let head = format_args!("\"user\":{},\"role\":\"{role}\",\"expires_s\":{expires}", Quoted(&name));
        let token = Shown(token);
        if is_told {
            response.json(200, format_args!("{{{head},\"token\":\"{token}\"}}"));
        } else {
            response.json(200, format_args!("{{{head}}}"));
            response.header = Some(Header::Cookie(Some(token), self.terms.encrypted));
        }
        Ok(())
    }

    /// The candidate, where the board has one.
    pub(super) fn candidate(&self, response: &mut Response<'a, 'g>) -> Result<&'a Candidate, Refused> {
        self.gateway.candidate().ok_or_else(|| uncommitted(&Uncommitted::Nothing, response))
    }

    /// Refuses unless a candidate is open.
    fn check_candidate(&self, response: &mut Response<'a, 'g>) -> Result<(), Refused> {
        let settings = self.candidate(response)?.settings();
        settings.map(drop).map_err(|error| uncommitted(&error, response))
    }

    async fn change(
        &self,
        lines: Lines<'_>,
        replaces: bool,
        response: &mut Response<'a, 'g>,
    ) -> Result<(), Refused> {
        // As many as fit.
        let mut warnings = String::<{ TEXT_BYTES_MAX * 3 / 4 }>::new();
        let mut warn = |line: usize, warning: &crate::language::Warning| {
            let length = warnings.len();
            let comma = if warnings.is_empty() { "" } else { "," };
            let message = Quoted(warning);
            if write!(warnings, "{comma}{{\"line\":{line},\"message\":{message}}}").is_err() {
                warnings.truncate(length);
            }
        };
        match candidate::change(self.gateway, lines, replaces, &mut warn).await {
            Ok(count) => {
                response.json(200, format_args!("{{\"changes\":{count},\"warnings\":[{warnings}]}}"));
                Ok(())
            }
            Err(Unchanged::Untaken(error)) => Err(untaken(&error, response)),
            Err(Unchanged::Uncommitted(error)) => Err(uncommitted(&error, response)),
        }
    }

    async fn commit(
        &self,
        caller: &Caller,
        body: &str,
        response: &mut Response<'a, 'g>,
    ) -> Result<(), Refused> {
        let (checks, confirmed) = parse(body, COMMIT, response)
            .map(|members| (members.is_set("check"), members.number("confirmed")))?;
        if checks {
            let settings = self.candidate(response)?.settings();
            let checked = settings.and_then(|settings| Ok(self.gateway.check(&settings)?));
            return checked.map_err(|error| uncommitted(&error, response));
        }
        let confirmed = confirmed.map(|seconds| Duration::from_secs(seconds.into()));
        if confirmed.is_some_and(|time| !access::may_wait(time)) {
            return Err(response.error(422, &"confirmed: expected 10 to 86400 seconds"));
        }
        self.put_in_force(caller, confirmed, response).await
    }

    async fn confirm(&self, caller: &Caller, response: &mut Response<'a, 'g>) -> Result<(), Refused> {
        if !self.gateway.candidate().is_some_and(Candidate::is_waiting) {
            return Err(uncommitted(&Uncommitted::NotWaiting, response));
        }
        self.put_in_force(caller, None, response).await
    }

    async fn put_in_force(
        &self,
        caller: &Caller,
        confirmed: Option<Duration>,
        response: &mut Response<'a, 'g>,
    ) -> Result<(), Refused> {
        let gateway = self.gateway;
        let candidate = self.candidate(response)?;
        match confirmed {
            Some(time) => {
                let what = format_args!("commit confirmed {}s", time.as_secs());
                gateway.audit(Topic::Command, self.actor(caller), what);
            }
            None => gateway.audit(Topic::Command, self.actor(caller), format_args!("commit")),
        }
        let mut store = self.store.lock().await;
        let who = (self.actor(caller), Way { port: Some(self.port), by_name: caller.by_name });
        let done = candidate.commit(gateway, *store, confirmed, who).await;
        done.map_err(|error| uncommitted(&error, response))
    }

    async fn roll_back(&self, caller: &Caller, response: &mut Response<'a, 'g>) -> Result<(), Refused> {
        let candidate = self.gateway.candidate();
        let candidate = candidate.ok_or_else(|| uncommitted(&Uncommitted::NotWaiting, response))?;
        self.gateway.audit(Topic::Command, self.actor(caller), format_args!("rollback"));
        let done = candidate.roll_back(self.gateway, self.actor(caller)).await;
        done.map_err(|error| uncommitted(&error, response))
    }

    /// `read`, `write`, `ping`: the request, which is still to be made; or why it cannot be.
    fn ask(
        &self,
        caller: &Caller,
        ask: Ask,
        body: &str,
        response: &mut Response<'a, 'g>,
    ) -> Result<(), Refused> {
        let verb = match ask {
            Ask::Ping => "ping",
            Ask::Read => "read",
            Ask::Write => "write",
        };
        let line = line(body, DIRECT, verb, response)?;
        let asked = Asked::new(self.gateway, ask, &line).map_err(|error| match error {
            NotAsked::Line(error) => response.wrong_line(1, &line, &error),
            error @ NotAsked::Request(_) => response.error(409, &error),
        })?;
        if ask == Ask::Write {
            self.gateway.audit(Topic::Command, self.actor(caller), format_args!("{line}"));
        }
        response.ok(Content::Values(asked, Part::default()));
        Ok(())
    }
}
