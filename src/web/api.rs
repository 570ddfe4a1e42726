//! A request: who sends it, and whether the user may.

use core::net::IpAddr;

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embassy_time::{Duration, Timer};
use picoserve::ResponseSent;
use picoserve::io::Read;
use picoserve::request::{Path, Request, RequestParts};
use picoserve::response::ResponseWriter;
use picoserve::routing::PathRouterService;

use super::guard::{self, Foreign};
use super::headers::Header;
use super::metrics::Metrics;
use super::page;
use super::piece::Source;
use super::response::{Content, Refused, Response};
use super::routes::{self, Call, METRICS, Method, Methods, ROUTES, Takes};
use super::session::{self, Shows};
use super::transport::Life;
use crate::console::access::{self, Denied};
use crate::gateway::Gateway;
use crate::gateway::audit::{Actor, Topic};
use crate::gateway::web::Token;
use crate::hal::{Store, System, Update};
use crate::settings::{HttpSettings, Name, PortId, Role};

/// The longest scan, at all speeds, takes a quarter of an hour with the time-out that is usual, and hours with a long one.
const WORK_MAX: Duration = Duration::from_secs(12 * 3_600);

const CLEARTEXT: &str = "it is not encrypted: from this machine only, unless the port says tls or cleartext";
const LOG_IN: &str = "log in first: POST /api/v1/session with user and password";

/// What a client may do at the port.
#[derive(Debug, Clone, Copy)]
pub(super) struct Terms {
    /// By TLS.
    pub(super) encrypted: bool,
    /// Log in, and what needs that.
    logs_in: bool,
    /// Read the metrics without a log-in.
    metrics: bool,
}

impl Terms {
    pub(super) fn of(server: &HttpSettings, peer: IpAddr) -> Self {
        let encrypted = server.is_encrypted();
        let logs_in = encrypted || server.cleartext || peer.is_loopback();
        Self { encrypted, logs_in, metrics: server.metrics }
    }
}

/// The interface for one connection.
pub(super) struct Api<'a, 'g, S, U, Y> {
    pub(super) gateway: &'a Gateway<'g>,
    pub(super) store: Mutex<NoopRawMutex, &'a mut S>,
    pub(super) update: Mutex<NoopRawMutex, &'a mut U>,
    pub(super) system: &'a Y,
    /// The port, and the client.
    pub(super) port: PortId,
    pub(super) peer: IpAddr,
    pub(super) terms: Terms,
    /// The connection.
    pub(super) life: &'a Life,
}

pub(super) struct Caller {
    pub(super) name: Name,
    pub(super) role: Role,
    pub(super) token: Token,
    /// Has addressed the gateway by its mDNS name.
    pub(super) by_name: bool,
}

impl<S: Store, U: Update, Y: System> PathRouterService for Api<'_, '_, S, U, Y> {
    async fn call_path_router_service<R: Read, W: ResponseWriter<Error = R::Error>>(
        &self,
        (): &(),
        (): (),
        path: Path<'_>,
        mut request: Request<'_, R>,
        writer: W,
    ) -> Result<ResponseSent, W::Error> {
        let turn = self.gateway.web.turns.take(embassy_time::Instant::now());
        Timer::at(turn).await;
        let mut response = Response::new();
        // A refusal has told why.
        let _ = self.respond(path.encoded(), &mut request, &mut response).await;
        let connection = request.body_connection.finalize().await?;
        response.send(Source { gateway: self.gateway, system: self.system }, connection, writer).await
    }
}

impl<'a, 'g, S: Store, U: Update, Y: System> Api<'a, 'g, S, U, Y> {
    /// The user, for the audit trail.
    pub(super) fn actor<'c>(&self, caller: &'c Caller) -> Actor<'c> {
        Actor::User { name: &caller.name, peer: self.peer }
    }

    /// The connection stays open for the longest work, as long as the client reads.
    pub(super) fn takes_long(&self) {
        self.life.lasts(WORK_MAX);
    }

    async fn respond<R: Read>(
        &self,
        path: &str,
        request: &mut Request<'_, R>,
        response: &mut Response<'a, 'g>,
    ) -> Result<(), Refused> {
        let parts = &request.parts;
        if let Some(file) = page::find(path) {
            return self.file(file, parts, response);
        }
        let (call, takes, caller) = self.admit(path, parts, response)?;
        let body = request.body_connection.body();
        takes.check(parts, body.content_length(), response)?;
        if let (Takes::Image, Some(caller)) = (takes, &caller) {
            return self.update(caller, body, response).await;
        }
        if !body.entire_body_fits_into_buffer() {
            return Err(response.error(413, &"the body is too large"));
        }
        let body = body.read_all().await;
        let body = body.map_err(|_| response.error(400, &"the body did not come as announced"))?;
        let body = core::str::from_utf8(body);
        let body = body.map_err(|_| response.error(400, &"the body is not text (UTF-8)"))?;
        match (call, &caller) {
            (Call::Metrics, _) => response.ok(Content::Metrics(Metrics::of(parts.headers()))),
            (_, Some(caller)) => self.run(call, caller, body, response).await?,
            (_, None) => self.log_in(body, response).await?,
        }
        response.settle().await
    }

    /// A file of the page. It may be opened from anywhere, but by a name of the gateway.
    fn file(
        &self,
        file: &'static page::File,
        parts: &RequestParts<'_>,
        response: &mut Response<'a, 'g>,
    ) -> Result<(), Refused> {
        let headers = parts.headers();
        let encrypted = self.terms.encrypted;
        let host =
            self.gateway.settings(|settings| guard::check_host(headers, settings, encrypted).map(drop));
        host.map_err(|why| foreign(why, response))?;
        if !self.terms.logs_in {
            return Err(response.error(403, &CLEARTEXT));
        }
        if parts.method() != "GET" {
            return Err(not_allowed(Methods(file.path), response));
        }
        let known = headers.get("if-none-match");
        let known = known.as_ref().and_then(|known| known.as_str().ok()).unwrap_or_default();
        let has = |tag: &str| tag.strip_prefix("W/").unwrap_or(tag) == file.tag;
        response.file(file, known.split(',').map(str::trim).any(has));
        Ok(())
    }

    /// Finds the operation and the caller, who is anonymous at log-in; or refuses.
    fn admit(
        &self,
        path: &str,
        parts: &RequestParts<'_>,
        response: &mut Response<'a, 'g>,
    ) -> Result<(Call, Takes, Option<Caller>), Refused> {
        let headers = parts.headers();
        let encrypted = self.terms.encrypted;
        let checked = self.gateway.settings(|settings| guard::check(headers, settings, encrypted));
        let by_name = checked.map_err(|why| foreign(why, response))?;
        if path == METRICS && self.terms.metrics && parts.method() == "GET" {
            return Ok((Call::Metrics, Takes::Nothing, None));
        }
        if !self.terms.logs_in {
            return Err(response.error(403, &CLEARTEXT));
        }
        let path = routes::short(path);
        let mut routes = ROUTES.iter().filter(|(known, ..)| *known == path).peekable();
        let Some((known, ..)) = routes.peek() else {
            return Err(response.error(404, &"there is nothing of this path: see openapi.yaml"));
        };
        let methods = Methods(known);
        let route = routes.find(|(_, method, ..)| parts.method() == method.name());
        let (_, method, call, takes, command) = *route.ok_or_else(|| not_allowed(methods, response))?;
        if call == Call::LogIn {
            return Ok((call, takes, None));
        }
        let caller = Shows::of(headers).and_then(|shows| {
            let (name, role) = session::user(self.gateway, &shows.token, true)?;
            Some((Caller { name, role, token: shows.token, by_name }, shows.by_cookie))
        });
        let Some((caller, by_cookie)) = caller else {
            response.header = Some(Header::Authenticate);
            return Err(response.error(401, &LOG_IN));
        };
        if by_cookie && method != Method::Get {
            guard::check_cookie(headers).map_err(|why| foreign(why, response))?;
        }
        let needed = command.map_or(Role::Viewer, access::role);
        if caller.role < needed {
            let what = format_args!("{} is denied to the role {}", command.unwrap_or_default(), caller.role);
            self.gateway.audit_refusal(Topic::DeniedCommand, None, Some(self.peer), what);
            return Err(response.error(403, &Denied::Role { needed, own: caller.role }));
        }
        Ok((call, takes, Some(caller)))
    }
}

fn foreign(why: Foreign, response: &mut Response<'_, '_>) -> Refused {
    response.error(if why == Foreign::Host { 421 } else { 403 }, &why)
}

/// Another method is needed.
fn not_allowed(methods: Methods, response: &mut Response<'_, '_>) -> Refused {
    response.header = Some(Header::Allow(methods));
    response.error(405, &format_args!("this path takes {methods}"))
}

impl Takes {
    /// Checks the body's length and type.
    fn check(
        self,
        parts: &RequestParts<'_>,
        length: usize,
        response: &mut Response<'_, '_>,
    ) -> Result<(), Refused> {
        if parts.headers().get("transfer-encoding").is_some() {
            return Err(response.error(411, &"a body needs its length: Content-Length"));
        }
        let kind = match self {
            Self::Nothing if length > 0 => return Err(response.error(400, &"this takes no body")),
            Self::Nothing => return Ok(()),
            Self::Lines => "text/plain",
            Self::Json => "application/json",
            Self::Image => "application/octet-stream",
        };
        let told = parts.headers().get("content-type");
        let told = told.as_ref().and_then(|told| told.as_str().ok()).unwrap_or_default();
        let told = told.split_once(';').map_or(told, |(told, _parameters)| told);
        match told.trim().eq_ignore_ascii_case(kind) {
            true => Ok(()),
            false => Err(response.error(415, &format_args!("the body must be {kind}"))),
        }
    }
}
