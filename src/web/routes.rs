//! The paths of the interface, with the role each requires. The table is the whole interface.

use core::fmt::{self, Display};

use self::Method::{Delete, Get, Post, Put};
use super::status::TableOf;
use crate::console::access::{Ask, Show};

/// The operations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Call {
    LogIn,
    Session,
    LogOut,
    Status,
    Events,
    /// As lines, or as JSON.
    Settings(bool),
    Candidate(bool),
    /// What that JSON is.
    Schema,
    /// Replaces or changes the candidate, by lines or by JSON.
    Replace,
    Change,
    ReplaceJson,
    ChangeJson,
    Discard,
    Diff,
    Commit,
    Confirm,
    RollBack,
    Direct(Ask),
    /// Only these tables.
    Tables(&'static [TableOf]),
    /// Lists the saved versions, or makes one the candidate.
    Versions,
    BringBack,
    Password,
    Scan,
    Tune,
    /// Ends one of those.
    Stop,
    Explain,
    /// Writes a data point.
    Point,
    Frames,
    /// What runs, and whether it is on trial.
    Firmware,
    /// Counters for Prometheus.
    Metrics,
    /// Installs new firmware, or reverts firmware on trial.
    Update,
    GoBack,
}

/// The kind of a request's body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Takes {
    Nothing,
    Lines,
    Json,
    /// New firmware, processed as it arrives.
    Image,
}

/// The methods in use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Method {
    Get,
    Post,
    Put,
    Delete,
}

impl Method {
    pub(super) const fn name(self) -> &'static str {
        match self {
            Get => "GET",
            Post => "POST",
            Put => "PUT",
            Delete => "DELETE",
        }
    }
}

/// What the paths of the table begin with, but for [`METRICS`].
const API: &str = "/api/v1/";

/// A path as the table has it; `/api/v1//metrics` is not [`METRICS`].
pub(super) fn short(path: &str) -> &str {
    path.strip_prefix(API).filter(|rest| !rest.starts_with('/')).unwrap_or(path)
}

/// Path, method, call, body, and the console command that needs the same role; `None`: any user.
pub(super) type Route = (&'static str, Method, Call, Takes, Option<&'static str>);

/// Where Prometheus looks.
pub(super) const METRICS: &str = "/metrics";

pub(super) const ROUTES: &[Route] = &[
    ("session", Post, Call::LogIn, Takes::Json, None),
    ("session", Get, Call::Session, Takes::Nothing, None),
    ("session", Delete, Call::LogOut, Takes::Nothing, None),
    ("status", Get, Call::Status, Takes::Nothing, Some("show")),
    ("events", Get, Call::Events, Takes::Nothing, Some("show")),
    ("settings", Get, Call::Settings(false), Takes::Nothing, Some("show")),
    ("settings/json", Get, Call::Settings(true), Takes::Nothing, Some("show")),
    ("settings/schema", Get, Call::Schema, Takes::Nothing, Some("show")),
    ("settings/candidate", Get, Call::Candidate(false), Takes::Nothing, Some("show")),
    ("settings/candidate/json", Get, Call::Candidate(true), Takes::Nothing, Some("show")),
    ("settings/candidate/json", Put, Call::ReplaceJson, Takes::Json, Some("candidate")),
    ("settings/candidate/json", Post, Call::ChangeJson, Takes::Json, Some("candidate")),
    ("settings/candidate", Put, Call::Replace, Takes::Lines, Some("candidate")),
    ("settings/candidate", Post, Call::Change, Takes::Lines, Some("candidate")),
    ("settings/candidate", Delete, Call::Discard, Takes::Nothing, Some("discard")),
    ("settings/diff", Get, Call::Diff, Takes::Nothing, Some("diff")),
    ("settings/commit", Post, Call::Commit, Takes::Json, Some("commit")),
    ("settings/confirm", Post, Call::Confirm, Takes::Nothing, Some("commit")),
    ("settings/rollback", Post, Call::RollBack, Takes::Nothing, Some("rollback")),
    ("settings/versions", Get, Call::Versions, Takes::Nothing, Some("versions")),
    ("settings/versions", Post, Call::BringBack, Takes::Json, Some("rollback")),
    ("password", Post, Call::Password, Takes::Json, Some("password")),
    ("log", Get, Call::Tables(&[("log", Some(Show::Transactions))]), Takes::Nothing, Some("show")),
    ("audit", Get, Call::Tables(&[("audit", Some(Show::Audit))]), Takes::Nothing, Some("password")),
    ("users", Get, Call::Tables(&[("users", Some(Show::Users))]), Takes::Nothing, Some("show")),
    ("units", Get, Call::Tables(&[("units", Some(Show::Details))]), Takes::Nothing, Some("show")),
    ("network", Get, Call::Tables(&[("network", Some(Show::Network))]), Takes::Nothing, Some("show")),
    ("lines", Get, Call::Tables(&[("lines", Some(Show::Lines))]), Takes::Nothing, Some("show")),
    ("ethercat", Get, Call::Tables(ETHERCAT), Takes::Nothing, Some("show")),
    ("update", Get, Call::Firmware, Takes::Nothing, Some("show")),
    ("update", Post, Call::Update, Takes::Image, Some("update")),
    ("update", Delete, Call::GoBack, Takes::Nothing, Some("update")),
    ("frames", Get, Call::Frames, Takes::Nothing, Some("watch")),
    (METRICS, Get, Call::Metrics, Takes::Nothing, Some("show")),
    ("scan", Post, Call::Scan, Takes::Json, Some("scan")),
    ("tune", Post, Call::Tune, Takes::Json, Some("tune")),
    ("stop", Post, Call::Stop, Takes::Nothing, Some("scan")),
    ("explain", Post, Call::Explain, Takes::Json, Some("explain")),
    ("point", Post, Call::Point, Takes::Json, Some("write")),
    ("read", Post, Call::Direct(Ask::Read), Takes::Json, Some("read")),
    ("write", Post, Call::Direct(Ask::Write), Takes::Json, Some("write")),
    ("ping", Post, Call::Direct(Ask::Ping), Takes::Json, Some("ping")),
];

const ETHERCAT: &[TableOf] =
    &[("ethercat", Some(Show::Ethercat)), ("modules", Some(Show::Modules)), ("image", Some(Show::Image))];

/// The methods that a path takes.
#[derive(Clone, Copy)]
pub(super) struct Methods(pub(super) &'static str);

impl Display for Methods {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut routes = ROUTES.iter().filter(|(path, ..)| *path == self.0);
        // A path without a route is a file's.
        f.write_str(routes.next().map_or(Get, |(_, method, ..)| *method).name())?;
        routes.try_for_each(|(_, method, ..)| write!(f, ", {}", method.name()))
    }
}
