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

/// Path, method, call, body, and the console command that needs the same role; `None`: any user.
pub(super) type Route = (&'static str, &'static str, Call, Takes, Option<&'static str>);

/// Where Prometheus looks.
pub(super) const METRICS: &str = "/metrics";

pub(super) const ROUTES: &[Route] = &[
    ("/api/v1/session", "POST", Call::LogIn, Takes::Json, None),
    ("/api/v1/session", "GET", Call::Session, Takes::Nothing, None),
    ("/api/v1/session", "DELETE", Call::LogOut, Takes::Nothing, None),
    ("/api/v1/status", "GET", Call::Status, Takes::Nothing, Some("show")),
    ("/api/v1/events", "GET", Call::Events, Takes::Nothing, Some("show")),
    ("/api/v1/settings", "GET", Call::Settings(false), Takes::Nothing, Some("show")),
    ("/api/v1/settings/json", "GET", Call::Settings(true), Takes::Nothing, Some("show")),
    ("/api/v1/settings/schema", "GET", Call::Schema, Takes::Nothing, Some("show")),
    ("/api/v1/settings/candidate", "GET", Call::Candidate(false), Takes::Nothing, Some("show")),
    ("/api/v1/settings/candidate/json", "GET", Call::Candidate(true), Takes::Nothing, Some("show")),
    ("/api/v1/settings/candidate/json", "PUT", Call::ReplaceJson, Takes::Json, Some("candidate")),
    ("/api/v1/settings/candidate/json", "POST", Call::ChangeJson, Takes::Json, Some("candidate")),
    ("/api/v1/settings/candidate", "PUT", Call::Replace, Takes::Lines, Some("candidate")),
    ("/api/v1/settings/candidate", "POST", Call::Change, Takes::Lines, Some("candidate")),
    ("/api/v1/settings/candidate", "DELETE", Call::Discard, Takes::Nothing, Some("discard")),
    ("/api/v1/settings/diff", "GET", Call::Diff, Takes::Nothing, Some("diff")),
    ("/api/v1/settings/commit", "POST", Call::Commit, Takes::Json, Some("commit")),
    ("/api/v1/settings/confirm", "POST", Call::Confirm, Takes::Nothing, Some("commit")),
    ("/api/v1/settings/rollback", "POST", Call::RollBack, Takes::Nothing, Some("rollback")),
    ("/api/v1/settings/versions", "GET", Call::Versions, Takes::Nothing, Some("versions")),
    ("/api/v1/settings/versions", "POST", Call::BringBack, Takes::Json, Some("rollback")),
    ("/api/v1/password", "POST", Call::Password, Takes::Json, Some("password")),
    ("/api/v1/log", "GET", Call::Tables(&[("log", Some(Show::Transactions))]), Takes::Nothing, Some("show")),
    ("/api/v1/audit", "GET", Call::Tables(&[("audit", Some(Show::Audit))]), Takes::Nothing, Some("password")),
    ("/api/v1/users", "GET", Call::Tables(&[("users", Some(Show::Users))]), Takes::Nothing, Some("show")),
    ("/api/v1/units", "GET", Call::Tables(&[("units", Some(Show::Details))]), Takes::Nothing, Some("show")),
    (
        "/api/v1/network",
        "GET",
        Call::Tables(&[("network", Some(Show::Network))]),
        Takes::Nothing,
        Some("show"),
    ),
    ("/api/v1/ethercat", "GET", Call::Tables(ETHERCAT), Takes::Nothing, Some("show")),
    ("/api/v1/update", "GET", Call::Firmware, Takes::Nothing, Some("show")),
    ("/api/v1/update", "POST", Call::Update, Takes::Image, Some("update")),
    ("/api/v1/update", "DELETE", Call::GoBack, Takes::Nothing, Some("update")),
    ("/api/v1/frames", "GET", Call::Frames, Takes::Nothing, Some("watch")),
    (METRICS, "GET", Call::Metrics, Takes::Nothing, Some("show")),
    ("/api/v1/scan", "POST", Call::Scan, Takes::Json, Some("scan")),
    ("/api/v1/tune", "POST", Call::Tune, Takes::Json, Some("tune")),
    ("/api/v1/stop", "POST", Call::Stop, Takes::Nothing, Some("scan")),
    ("/api/v1/explain", "POST", Call::Explain, Takes::Json, Some("explain")),
    ("/api/v1/point", "POST", Call::Point, Takes::Json, Some("write")),
    ("/api/v1/read", "POST", Call::Direct(Ask::Read), Takes::Json, Some("read")),
    ("/api/v1/write", "POST", Call::Direct(Ask::Write), Takes::Json, Some("write")),
    ("/api/v1/ping", "POST", Call::Direct(Ask::Ping), Takes::Json, Some("ping")),
];

const ETHERCAT: &[TableOf] = &[("ethercat", Some(Show::Ethercat)), ("modules", Some(Show::Modules))];

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
