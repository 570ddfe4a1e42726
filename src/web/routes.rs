//! The paths of the interface, with the role each requires. The table is the whole interface.

use core::fmt::{self, Display};

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

/// What the paths of the table begin with, but for [`METRICS`].
const API: &str = "/api/v1/";

/// A path as the table has it.
pub(super) fn short(path: &str) -> &str {
    path.strip_prefix(API).filter(|rest| !rest.starts_with('/')).unwrap_or(path)
}

/// Path, method, call, body, and the console command that needs the same role; `None`: any user.
pub(super) type Route = (&'static str, &'static str, Call, Takes, Option<&'static str>);

/// Where Prometheus looks.
pub(super) const METRICS: &str = "/metrics";

pub(super) const ROUTES: &[Route] = &[
    ("session", "POST", Call::LogIn, Takes::Json, None),
    ("session", "GET", Call::Session, Takes::Nothing, None),
    ("session", "DELETE", Call::LogOut, Takes::Nothing, None),
    ("status", "GET", Call::Status, Takes::Nothing, Some("show")),
    ("events", "GET", Call::Events, Takes::Nothing, Some("show")),
    ("settings", "GET", Call::Settings(false), Takes::Nothing, Some("show")),
    ("settings/json", "GET", Call::Settings(true), Takes::Nothing, Some("show")),
    ("settings/schema", "GET", Call::Schema, Takes::Nothing, Some("show")),
    ("settings/candidate", "GET", Call::Candidate(false), Takes::Nothing, Some("show")),
    ("settings/candidate/json", "GET", Call::Candidate(true), Takes::Nothing, Some("show")),
    ("settings/candidate/json", "PUT", Call::ReplaceJson, Takes::Json, Some("candidate")),
    ("settings/candidate/json", "POST", Call::ChangeJson, Takes::Json, Some("candidate")),
    ("settings/candidate", "PUT", Call::Replace, Takes::Lines, Some("candidate")),
    ("settings/candidate", "POST", Call::Change, Takes::Lines, Some("candidate")),
    ("settings/candidate", "DELETE", Call::Discard, Takes::Nothing, Some("discard")),
    ("settings/diff", "GET", Call::Diff, Takes::Nothing, Some("diff")),
    ("settings/commit", "POST", Call::Commit, Takes::Json, Some("commit")),
    ("settings/confirm", "POST", Call::Confirm, Takes::Nothing, Some("commit")),
    ("settings/rollback", "POST", Call::RollBack, Takes::Nothing, Some("rollback")),
    ("settings/versions", "GET", Call::Versions, Takes::Nothing, Some("versions")),
    ("settings/versions", "POST", Call::BringBack, Takes::Json, Some("rollback")),
    ("password", "POST", Call::Password, Takes::Json, Some("password")),
    ("log", "GET", Call::Tables(&[("log", Some(Show::Transactions))]), Takes::Nothing, Some("show")),
    ("audit", "GET", Call::Tables(&[("audit", Some(Show::Audit))]), Takes::Nothing, Some("password")),
    ("users", "GET", Call::Tables(&[("users", Some(Show::Users))]), Takes::Nothing, Some("show")),
    ("units", "GET", Call::Tables(&[("units", Some(Show::Details))]), Takes::Nothing, Some("show")),
    ("network", "GET", Call::Tables(&[("network", Some(Show::Network))]), Takes::Nothing, Some("show")),
    ("lines", "GET", Call::Tables(&[("lines", Some(Show::Lines))]), Takes::Nothing, Some("show")),
    ("ethercat", "GET", Call::Tables(ETHERCAT), Takes::Nothing, Some("show")),
    ("update", "GET", Call::Firmware, Takes::Nothing, Some("show")),
    ("update", "POST", Call::Update, Takes::Image, Some("update")),
    ("update", "DELETE", Call::GoBack, Takes::Nothing, Some("update")),
    ("frames", "GET", Call::Frames, Takes::Nothing, Some("watch")),
    (METRICS, "GET", Call::Metrics, Takes::Nothing, Some("show")),
    ("scan", "POST", Call::Scan, Takes::Json, Some("scan")),
    ("tune", "POST", Call::Tune, Takes::Json, Some("tune")),
    ("stop", "POST", Call::Stop, Takes::Nothing, Some("scan")),
    ("explain", "POST", Call::Explain, Takes::Json, Some("explain")),
    ("point", "POST", Call::Point, Takes::Json, Some("write")),
    ("read", "POST", Call::Direct(Ask::Read), Takes::Json, Some("read")),
    ("write", "POST", Call::Direct(Ask::Write), Takes::Json, Some("write")),
    ("ping", "POST", Call::Direct(Ask::Ping), Takes::Json, Some("ping")),
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
        f.write_str(routes.next().map_or("GET", |(_, method, ..)| method))?;
        routes.try_for_each(|(_, method, ..)| write!(f, ", {method}"))
    }
}
