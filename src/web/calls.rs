//! What the calls do.

use core::fmt::{Display, Write};

use embassy_time::{Duration, Instant};
use heapless::{String, Vec};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::api::{Api, Call, Caller};
use super::candidate::{self, Unchanged};
use super::json::Quoted;
use super::lines::{Lines, Untaken};
use super::response::{Content, Part, Response, TEXT_BYTES_MAX};
use super::session::{COOKIE, Shown};
use super::settings::{Schema, Written};
use super::status::Status;
use crate::console::access::{self, Ask, Denied, NotAsked};
use crate::gateway::audit::Topic;
use crate::gateway::commit::Uncommitted;
use crate::gateway::difference::Difference;
use crate::gateway::direct_request::DirectRequestError;
use crate::gateway::enter::Refused;
use crate::gateway::web::Token;
use crate::gateway::{Candidate, Credential};
use crate::hal::{Store, System, Update};
use crate::settings::Name;

/// Fits each text of a body in which characters are escaped.
const UNESCAPED_BYTES_MAX: usize = 256;
/// Values of a write.
pub(super) const VALUES_MAX: usize = 128;
/// Fits the line of a request with this many values, or a quarter of them without `long-requests`.
pub(super) type Line = String<{ if cfg!(feature = "long-requests") { 4_096 } else { 1_024 } }>;
/// A word of such a line.
pub(super) type Word = String<32>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LogIn {
    user: String<64>,
    password: String<64>,
    /// The token is told, and no cookie is set.
    #[serde(default)]
    token: bool,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct Commit {
    #[serde(default)]
    check: bool,
    /// Seconds.
    #[serde(default)]
    confirmed: Option<u32>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Direct {
    port: Word,
    unit: u8,
    table: Option<Word>,
    address: Option<u16>,
    count: Option<u16>,
    #[serde(rename = "type")]
    kind: Option<Word>,
    order: Option<Word>,
    values: Option<Vec<f64, VALUES_MAX>>,
}

/// Reads a body.
pub(super) fn parse<'s, 'g, T: DeserializeOwned>(body: &str) -> Result<T, Response<'s, 'g>> {
    let wrong =
        |what: &dyn Display| Response::error(400, &format_args!("the body is not as described: {what}"));
    let mut unescaped = [0; UNESCAPED_BYTES_MAX];
    let parsed = serde_json_core::from_slice_escaped(body.as_bytes(), &mut unescaped);
    let (value, used) = parsed.map_err(|error| wrong(&error))?;
    match body.get(used..).is_none_or(|rest| rest.trim().is_empty()) {
        true => Ok(value),
        false => Err(wrong(&"something follows the object")),
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
            Call::Direct(ask) => self.ask(caller, ask, body).await,
            Call::Scan | Call::Tune | Call::Explain | Call::Point => self.command(call, caller, body).await,
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
        let LogIn { user, password, token: is_told } = match parse(body) {
            Ok(log_in) => log_in,
            Err(refusal) => return refusal,
        };
        // No user has a longer name.
        let name = Name::try_from(user.as_str()).unwrap_or_default();
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
            Err(Unchanged::Untaken(Untaken::Line(number, line, error))) => {
                Response::wrong_line(Some(number), &line, &error)
            }
            Err(Unchanged::Untaken(error)) => Response::error(400, &error),
            Err(Unchanged::Uncommitted(error)) => uncommitted(&error),
        }
    }

    async fn commit(&self, caller: &Caller, body: &str) -> Response<'a, 'g> {
        let Commit { check, confirmed } = match parse(body) {
            Ok(commit) => commit,
            Err(refusal) => return refusal,
        };
        let gateway = self.gateway;
        if check {
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

    /// `read`, `write`, `ping`
    async fn ask(&self, caller: &Caller, ask: Ask, body: &str) -> Response<'a, 'g> {
        let line = match parse(body).and_then(|direct| line(ask, &direct)) {
            Ok(line) => line,
            Err(refusal) => return refusal,
        };
        let understood = || {
            if ask == Ask::Write {
                self.gateway.audit(Topic::Command, caller.actor(), format_args!("{line}"));
            }
        };
        match access::ask(self.gateway, ask, &line, understood).await {
            Ok(response) => Response::ok(Content::Values(response, Part::default())),
            Err(NotAsked::Line(error)) => Response::wrong_line(None, &line, &error),
            Err(NotAsked::Request(DirectRequestError::Broadcast)) => {
                Response::json(200, format_args!("{{\"unit\":0}}"))
            }
            Err(error @ NotAsked::Request(_)) => Response::error(409, &error),
        }
    }
}

/// The command's line for a request.
fn line<'s, 'g>(ask: Ask, direct: &Direct) -> Result<Line, Response<'s, 'g>> {
    let words = [Some(&direct.port), direct.table.as_ref(), direct.kind.as_ref(), direct.order.as_ref()];
    if !words.into_iter().flatten().all(is_word) {
        return Err(Response::error(422, &"port, table, type and order are one word each"));
    }
    let mut line = Line::new();
    write_line(ask, direct, &mut line).map_err(|_| Response::error(422, &"the request is too long"))?;
    Ok(line)
}

/// Whether it is one word of a line.
fn is_word(word: &Word) -> bool {
    !word.is_empty() && word.bytes().all(|byte| byte.is_ascii_graphic() && !b"\"#,".contains(&byte))
}

/// A line of a verb and these words; `None` if one is not a word.
pub(super) fn words(verb: &str, words: &[Option<&Word>]) -> Option<Line> {
    let mut line = Line::new();
    line.push_str(verb).ok()?;
    for word in words.iter().flatten() {
        write!(line, " {}", Some(word).filter(|word| is_word(word))?).ok()?;
    }
    Some(line)
}

fn write_line(ask: Ask, direct: &Direct, line: &mut Line) -> core::fmt::Result {
    let Direct { port, unit, table, address, count, kind, order, values } = direct;
    let verb = match ask {
        Ask::Ping => "ping",
        Ask::Read => "read",
        Ask::Write => "write",
    };
    write!(line, "{verb} {unit}")?;
    table.iter().try_for_each(|table| write!(line, " {table}"))?;
    address.iter().try_for_each(|address| write!(line, " {address}"))?;
    count.iter().try_for_each(|count| write!(line, " count {count}"))?;
    kind.iter().try_for_each(|kind| write!(line, " as {kind}"))?;
    order.iter().try_for_each(|order| write!(line, " order {order}"))?;
    values.iter().flatten().try_for_each(|value| write!(line, " {value}"))?;
    write!(line, " via {port}")
}
