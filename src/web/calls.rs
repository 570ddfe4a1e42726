//! What the calls do.

use core::fmt::Write;

use embassy_time::{Duration, Instant};
use heapless::String;

use super::api::{Api, Call, Caller};
use super::candidate::{self, Unchanged};
use super::json::Quoted;
use super::lines::Lines;
use super::members::{BYTE, Kind, Line, Member, Members, TEXT, WORD, needed, optional, via};
use super::response::{Content, Part, Response, TEXT_BYTES_MAX};
use super::session::{COOKIE, Shown};
use super::settings::{Schema, Written};
use super::status::Status;
use super::untaken::Untaken;
use crate::console::access::{self, Ask, Asked, Denied, NotAsked};
use crate::gateway::audit::Topic;
use crate::gateway::commit::Uncommitted;
use crate::gateway::difference::Difference;
use crate::gateway::enter::Refused;
use crate::gateway::web::Token;
use crate::gateway::{Candidate, Credential};
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
pub(super) fn parse<'s, 'g>(body: &str, members: &'static [Member]) -> Result<Members, Response<'s, 'g>> {
    Members::read(body, members).map_err(|error| untaken(&error))
}

pub(super) fn untaken<'s, 'g>(error: &Untaken) -> Response<'s, 'g> {
    match error {
        Untaken::Line(number, line, error) => Response::wrong_line(Some(*number), line, error),
        Untaken::NotAWord(_) | Untaken::TooLong => Response::error(422, error),
        #[cfg(feature = "long-values")] // As the error.
        Untaken::NoValue => Response::error(422, error),
        _ => Response::error(400, error),
    }
}

pub(super) fn uncommitted<'s, 'g>(error: &Uncommitted) -> Response<'s, 'g> {
    Response::error(if matches!(error, Uncommitted::Apply(_)) { 422 } else { 409 }, error)
}

impl<'a, 'g, S: Store, U: Update, Y: System> Api<'a, 'g, S, U, Y> {
    pub(super) async fn run(&self, call: Call, caller: &Caller, body: &str) -> Response<'a, 'g> {
        match call {
            // The first two need no session, and an image is processed as it arrives.
            Call::LogIn | Call::Metrics | Call::Update => Response::done(),
            Call::Session => {
                let (user, role) = (Quoted(&caller.name), caller.role);
                Response::json(200, format_args!("{{\"user\":{user},\"role\":\"{role}\"}}"))
            }
            Call::LogOut => {
                self.gateway.web.end(&caller.token);
                let cookie = format_args!("{COOKIE}=; {}; Max-Age=0", self.cookie_attributes());
                Response::done().with_header("Set-Cookie", cookie)
            }
            Call::Status => Response::ok(Content::Status(Status::new())),
            Call::Events => Response::ok(Content::Live(Status::new(), caller.token)),
            Call::Tables(tables) => Response::ok(Content::Status(Status::of(tables))),
            Call::Frames => {
                self.takes_long();
                Response::ok(Content::Frames(caller.token))
            }
            Call::Settings(as_json) => Response::ok(Content::Settings(Written::new(false, as_json))),
            Call::Candidate(as_json) => {
                self.with_candidate(|| Response::ok(Content::Settings(Written::new(true, as_json))))
            }
            Call::Schema => Response::ok(Content::Schema(Schema::default())),
            Call::Diff => {
                self.with_candidate(|| Response::ok(Content::Diff(Difference::default(), Part::default())))
            }
            Call::Replace | Call::Change => self.change(Lines::Text(body), call == Call::Replace).await,
            Call::ReplaceJson | Call::ChangeJson => {
                self.change(Lines::Json(body), call == Call::ReplaceJson).await
            }
            Call::Discard => self.of_candidate(Candidate::discard),
            Call::Commit => self.commit(caller, body).await,
            Call::Confirm => self.confirm(caller).await,
            Call::RollBack => self.roll_back(caller).await,
            Call::Direct(ask) => self.ask(caller, ask, body),
            Call::Scan | Call::Tune | Call::Explain | Call::Point => self.command(call, caller, body),
            Call::Stop => {
                self.gateway.web.stop.signal(());
                Response::done()
            }
            Call::Firmware => self.firmware(),
            Call::GoBack => self.go_back(caller),
            Call::Versions => self.versions().await,
            Call::BringBack => self.bring_back(caller, body).await,
            Call::Password => self.password(caller, body).await,
        }
    }

    /// `POST /session`
    pub(super) async fn log_in(&self, body: &str) -> Response<'a, 'g> {
        let (name, password, is_told) = match parse(body, LOG_IN) {
            // No user has a longer name.
            Ok(members) => (members.user().unwrap_or_default(), members.password(), members.is_set("token")),
            Err(refusal) => return refusal,
        };
        let gateway = self.gateway;
        let _one_at_a_time = gateway.web.log_in.lock().await;
        let user = match gateway.enter(self.system, self.peer, &name, Credential::Password(&password)).await {
            Ok(user) => user,
            Err(Refused::Pause(pause)) => {
                let refusal = Response::error(429, &Denied::Pause(pause));
                return refusal.with_header("Retry-After", format_args!("{}", pause.as_secs()));
            }
            Err(Refused::Wrong) => return Response::error(401, &Denied::Wrong),
        };
        let (role, now, mut token) = (user.role, Instant::now(), Token::default());
        // A log-in by password implies one.
        let password = user.password.unwrap_or_default();
        if !self.system.random(&mut token) {
            return Response::error(403, &Denied::NoHash);
        }
        let end = gateway.web.begin(token, name.clone(), password, now);
        let expires = end.saturating_duration_since(now).as_secs();
        let head = format_args!("\"user\":{},\"role\":\"{role}\",\"expires_s\":{expires}", Quoted(&name));
        let token = Shown(token);
        if is_told {
            return Response::json(200, format_args!("{{{head},\"token\":\"{token}\"}}"));
        }
        let cookie = format_args!("{COOKIE}={token}; {}", self.cookie_attributes());
        Response::json(200, format_args!("{{{head}}}")).with_header("Set-Cookie", cookie)
    }

    /// A page's scripts cannot read the cookie, and no other page sends it.
    fn cookie_attributes(&self) -> &'static str {
        match self.terms.encrypted {
            true => "HttpOnly; SameSite=Strict; Path=/; Secure",
            false => "HttpOnly; SameSite=Strict; Path=/",
        }
    }

    fn of_candidate(&self, run: impl FnOnce(&Candidate) -> Result<(), Uncommitted>) -> Response<'a, 'g> {
        match self.gateway.candidate().ok_or(Uncommitted::Nothing).and_then(run) {
            Ok(()) => Response::done(),
            Err(error) => uncommitted(&error),
        }
    }

    /// Responds if there is a candidate.
    fn with_candidate(&self, response: impl FnOnce() -> Response<'a, 'g>) -> Response<'a, 'g> {
        match self.gateway.candidate().map(|candidate| candidate.settings().map(|_| ())) {
            Some(Ok(())) => response(),
            Some(Err(error)) => uncommitted(&error),
            None => uncommitted(&Uncommitted::Nothing),
        }
    }

    async fn change(&self, lines: Lines<'_>, replaces: bool) -> Response<'a, 'g> {
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
                Response::json(200, format_args!("{{\"changes\":{count},\"warnings\":[{warnings}]}}"))
            }
            Err(Unchanged::Untaken(error)) => untaken(&error),
            Err(Unchanged::Uncommitted(error)) => uncommitted(&error),
        }
    }

    async fn commit(&self, caller: &Caller, body: &str) -> Response<'a, 'g> {
        let (checks, confirmed) = match parse(body, COMMIT) {
            Ok(members) => (members.is_set("check"), members.number("confirmed")),
            Err(refusal) => return refusal,
        };
        let gateway = self.gateway;
        if checks {
            return self.of_candidate(|candidate| Ok(gateway.check(&*candidate.settings()?)?));
        }
        let confirmed = confirmed.map(|seconds| Duration::from_secs(seconds.into()));
        if confirmed.is_some_and(|time| !access::may_wait(time)) {
            return Response::error(422, &"confirmed: expected 10 to 86400 seconds");
        }
        self.put_in_force(caller, confirmed).await
    }

    async fn confirm(&self, caller: &Caller) -> Response<'a, 'g> {
        if !self.gateway.candidate().is_some_and(Candidate::is_waiting) {
            return uncommitted(&Uncommitted::NotWaiting);
        }
        self.put_in_force(caller, None).await
    }

    async fn put_in_force(&self, caller: &Caller, confirmed: Option<Duration>) -> Response<'a, 'g> {
        let gateway = self.gateway;
        let Some(candidate) = gateway.candidate() else { return uncommitted(&Uncommitted::Nothing) };
        match confirmed {
            Some(time) => {
                let what = format_args!("commit confirmed {}s", time.as_secs());
                gateway.audit(Topic::Command, caller.actor(), what);
            }
            None => gateway.audit(Topic::Command, caller.actor(), format_args!("commit")),
        }
        let mut store = self.store.lock().await;
        match candidate.commit(gateway, *store, confirmed, (caller.actor(), Some(self.port))).await {
            Ok(()) => Response::done(),
            Err(error) => uncommitted(&error),
        }
    }

    async fn roll_back(&self, caller: &Caller) -> Response<'a, 'g> {
        let Some(candidate) = self.gateway.candidate() else { return uncommitted(&Uncommitted::NotWaiting) };
        self.gateway.audit(Topic::Command, caller.actor(), format_args!("rollback"));
        match candidate.roll_back(self.gateway, caller.actor()).await {
            Ok(()) => Response::done(),
            Err(error) => uncommitted(&error),
        }
    }

    /// `read`, `write`, `ping`: the request, which is still to be made; or why it cannot be.
    fn ask(&self, caller: &Caller, ask: Ask, body: &str) -> Response<'a, 'g> {
        let verb = match ask {
            Ask::Ping => "ping",
            Ask::Read => "read",
            Ask::Write => "write",
        };
        let line = match line(body, DIRECT, verb) {
            Ok(line) => line,
            Err(refusal) => return refusal,
        };
        match Asked::new(self.gateway, ask, &line) {
            Ok(asked) => {
                if ask == Ask::Write {
                    self.gateway.audit(Topic::Command, caller.actor(), format_args!("{line}"));
                }
                Response::ok(Content::Values(asked, Part::default()))
            }
            Err(NotAsked::Line(error)) => Response::wrong_line(None, &line, &error),
            Err(error @ NotAsked::Request(_)) => Response::error(409, &error),
        }
    }
}

/// The line of a verb for a body of these members.
pub(super) fn line<'s, 'g>(
    body: &str,
    members: &'static [Member],
    verb: &str,
) -> Result<Line, Response<'s, 'g>> {
    Members::read(body, members).and_then(|members| members.line(verb)).map_err(|error| untaken(&error))
}
