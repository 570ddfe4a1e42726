//! `show`: the tables, written row by row.

use core::fmt;

use embassy_time::Instant;

#[cfg(feature = "audit")]
use super::audit;
#[cfg(feature = "tls")] // As the topic.
use super::certificates;
#[cfg(feature = "web")] // As what uses it.
use super::details;
#[cfg(feature = "candidate")] // As the topic.
use super::diff;
use super::image;
use super::layout::{self, Columns, Layout};
use super::log_in::Denied;
use super::network::network;
use super::output::{NO_ROW, Nowhere, Output, Written};
use super::points;
#[cfg(feature = "mqtt")] // As the topic.
use super::publishers;
use super::registers;
use super::rows::{LineErrors, LogRow, Row, StatusText, age, cell, describe_unit, took};
use super::serial_lines;
use super::session::Session;
use super::table::{Source, titled};
use super::users;
use super::version;
use super::wait::Wait;
use crate::fieldbus::{Controller, EthercatState, LineWriter};
use crate::gateway::Gateway;
use crate::gateway::unit_health::{UNITS_MAX, Unit};
use crate::hal::System;
use crate::language::listed::listed;
use crate::language::{Shown, Words, Wrong, write_shown_line};
use crate::settings::{self, Endpoint, PortKind, Role, SERVERS, ServerSettings, Side, TLS};
use crate::stats::{Event, LOG_ENTRIES_MAX, LastError};

/// The topics of `show`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Show {
    Ports,
    Servers,
    Routes,
    Units,
    Clients,
    Stats,
    Points,
    Devices,
    Registers,
    Users,
    // Its row would take room in images without a trail.
    #[cfg(feature = "audit")]
    Audit,
    Config,
    /// The same with the hashes of passwords.
    Secrets,
    // Images without TLS have no certificates.
    #[cfg(feature = "tls")]
    Certificates,
    // As its line.
    #[cfg(feature = "mqtt")]
    Publishers,
    // Left out of images without a candidate.
    #[cfg(feature = "candidate")]
    Candidate,
    Network,
    Lines,
    Image,
    Log,
    /// Its table alone.
    // Only the web interface shows it.
    #[cfg(feature = "web")]
    Transactions,
    #[cfg(feature = "web")]
    Details,
    #[cfg(feature = "web")]
    Ethercat,
    #[cfg(feature = "web")]
    Modules,
    Frames,
    Version,
    Update,
}

/// The topics with their help.
pub(super) const TOPICS: &[(&str, (Show, &str))] = &[
    ("ports", (Show::Ports, "what the ports are, and how they do")),
    ("servers", (Show::Servers, "the servers of tcp clients that have several")),
    ("routes", (Show::Routes, "the rules by number; implied: the way back")),
    ("units", (Show::Units, "the devices: response times, and what went wrong")),
    ("clients", (Show::Clients, "who is connected")),
    ("stats", (Show::Stats, "what the ports counted, and how often a minute")),
    ("points", (Show::Points, "data points: how they do, and their values")),
    ("devices", (Show::Devices, "the devices that the scanner polls")),
    ("registers", (Show::Registers, "the gateway's own, where a rule leads to local")),
    ("users", (Show::Users, "who may log in")),
    #[cfg(feature = "audit")]
    ("audit", (Show::Audit, "who changed what, from where, and what was refused")),
    #[cfg(feature = "tls")]
    ("certificates", (Show::Certificates, "those of tls: whose, and until when")),
    #[cfg(feature = "mqtt")]
    ("publishers", (Show::Publishers, "the brokers that get the data points")),
    ("config", (Show::Config, "the settings as lines; config secrets: with hashes")),
    #[cfg(feature = "candidate")]
    ("candidate", (Show::Candidate, "what commit would put in force")),
    ("network", (Show::Network, "the board's own address")),
    ("lines", (Show::Lines, "the serial lines, and the ports that have them")),
    ("image", (Show::Image, "the values in the EtherCAT process image")),
    ("log", (Show::Log, "the last transactions")),
    ("frames", (Show::Frames, "the last frames, as they were on the wire")),
    ("version", (Show::Version, "what runs here, and for how long")),
    ("update", (Show::Update, "whether new firmware is on trial, or went back")),
];
const TOPICS_EXPECTED: &str = listed!(TOPICS);

impl Show {
    /// Why this session may not see it, if so.
    pub(super) fn denied(self, session: &Session<'_, '_>) -> Option<Denied> {
        let (own, is_local) = (session.role, session.peer.is_none());
        match self {
            Self::Secrets => {
                (settings::USERS && !(is_local && own == Role::Engineer)).then_some(Denied::NotLocal)
            }
            #[cfg(feature = "audit")]
            Self::Audit if own < Role::Engineer => Some(Denied::Role { needed: Role::Engineer, own }),
            _ => None,
        }
    }
}

/// Topics of other consoles, with their equivalents here.
const ELSEWHERE: &[(&str, &str)] = &[
    ("run", "config"),
    ("running-config", "config"),
    ("rules", "routes"),
    ("status", "ports"),
    ("interfaces", "ports"),
    ("connections", "clients"),
];

/// Parses the last word of a line as a topic.
pub(super) fn topic(words: &Words<'_>) -> Result<Show, Wrong> {
    let word = words.take();
    let name = |at: usize| TOPICS.get(at).map(|(name, _)| *name);
    let (show, _) = word.lookup(TOPICS).ok_or_else(|| word.unknown(&name, ELSEWHERE, TOPICS_EXPECTED))?;
    let secrets = settings::USERS && show == Show::Config && words.peek().is("secrets");
    if secrets {
        words.take();
    }
    words.end()?;
    Ok(if secrets { Show::Secrets } else { show })
}

/// A table being shown. Its content may change between rows.
pub(super) struct Table {
    what: Show,
    place: usize,
    now: Instant,
    /// The time of the first row.
    layout: Option<Layout>,
}

impl Table {
    pub(super) fn new(what: Show) -> Self {
        Self { what, place: 0, now: Instant::now(), layout: None }
    }

    /// Writes the next row to `out`.
    pub(super) fn row(&mut self, gateway: &Gateway<'_>, system: &dyn System, out: &mut Output) -> Wait {
        let Self { what, now, .. } = *self;
        let mut write = |place, out: &mut dyn fmt::Write| {
            gateway.settings(|settings| write(&Source { gateway, settings, now }, system, what, place, out))
        };
        let layout = self.layout.get_or_insert_with(|| Layout::of(columns(what), out.columns, &mut write));
        layout::row(out, layout, &mut self.place, &mut write)
    }
}

/// Writes the row at `place`, from 0, of a table.
pub(super) fn write(
    source: &Source<'_, '_>,
    system: &dyn System,
    what: Show,
    place: usize,
    out: &mut dyn fmt::Write,
) -> Written {
    let table =
        |heading,
         row: fn(&Source<'_, '_>, usize, &mut dyn fmt::Write) -> Written,
         out: &mut dyn fmt::Write| { titled(heading, place, out, |nth, out| row(source, nth, out)) };
    match what {
        Show::Ports => table(PORTS, port, out),
        Show::Servers => table(SERVER_LINES, server, out),
        Show::Routes => table(ROUTES, route, out),
        Show::Units => table(UNITS, unit, out),
        Show::Clients => table(CLIENTS, client, out),
        Show::Stats => table(STATS, count, out),
        Show::Points => points::row(source, place, out),
        Show::Devices => points::device(source, place, out),
        Show::Registers => registers::row(source, place, out),
        Show::Users if settings::USERS => table(users::HEAD, users::row, out),
        #[cfg(feature = "audit")]
        Show::Audit => audit::row(source, system, place, out),
        #[cfg(feature = "tls")]
        Show::Certificates => certificates::row(source, system, place, out),
        #[cfg(feature = "mqtt")]
        Show::Publishers => table(publishers::HEAD, publishers::row, out),
        Show::Config => write_shown_line(source.settings, place, Shown::WithoutSecrets, out),
        Show::Secrets => write_shown_line(source.settings, place, Shown::WithSecrets, out),
        #[cfg(feature = "candidate")]
        Show::Candidate => diff::row(source, place, out),
        Show::Network => network(source.settings, system.network(), place, out),
        Show::Lines => {
            titled(serial_lines::HEAD, place, out, |nth, out| serial_lines::row(source, system, nth, out))
        }
        Show::Image => table(image::HEAD, image::row, out),
        Show::Log => event(source, system, place, out),
        #[cfg(feature = "web")]
        Show::Transactions => titled(LOG, place, out, |nth, out| transaction(source, nth, out)),
        #[cfg(feature = "web")]
        Show::Details => table(details::UNITS, details::unit, out),
        #[cfg(feature = "web")]
        Show::Ethercat => table(details::ETHERCAT, details::ethercat, out),
        #[cfg(feature = "web")]
        Show::Modules => table(details::MODULES, details::module, out),
        Show::Version => version::row(source, system, place, out),
        Show::Update => version::update(system, place, out),
        Show::Frames | Show::Users => None,
    }
}

/// The columns of a table without the last one; none for plain lines.
const fn columns(what: Show) -> Columns {
    match what {
        Show::Ports => &[15, 12, 0, 12],
        Show::Servers => &[15, 7, 4, 21],
        Show::Routes => &[-3, 15, 7, 18, 4, 15, 7],
        Show::Units => &[15, -4, 11, -10, -10, -10, -10, -9, -9, -9],
        Show::Users => users::COLUMNS,
        #[cfg(feature = "audit")]
        Show::Audit => audit::COLUMNS,
        #[cfg(feature = "tls")]
        Show::Certificates => certificates::COLUMNS,
        #[cfg(feature = "mqtt")]
        Show::Publishers => publishers::COLUMNS,
        Show::Clients => &[15, 21, -9, -9, -4, -10],
        Show::Stats => &[15, 14, -10, -10],
        Show::Log => &[-9, 15, -4, 15, -6, -8, -10],
        Show::Lines => &[15],
        Show::Image => image::COLUMNS,
        Show::Network => &[4, 18, 15, 17],
        Show::Registers => &[5, 7],
        Show::Points => points::COLUMNS,
        Show::Devices => points::DEVICE_COLUMNS,
        _ => &[],
    }
}

const PORTS: &str = "PORT\tROLE\tWHERE\tLINE\tSTATUS";
const SERVER_LINES: &str = "PORT\tUNITS\tTAG\tWHERE\tSTATUS";
const ROUTES: &str = "NO\tSOURCE\tUNITS\tIP\tTAG\tDESTINATION\tKIND\tPOLICY";
const UNITS: &str = "PORT\tUNIT\tSTATE\tREQUESTS\tRESPONSES\tEXCEPTIONS\tTIMEOUTS\tLAST\tP50\tP99\tERRORS";
const CLIENTS: &str = "PORT\tPEER\tSINCE\tQUIET\tOPEN\tREQUESTS\tPLACE";
const STATS: &str = "PORT\tEVENT\tCOUNT\tPER-MINUTE";
const LOG: &str = "AGE\tSOURCE\tUNIT\tDESTINATION\tTARGET\tFUNCTION\tTOOK\tOUTCOME";

fn port(source: &Source<'_, '_>, row: usize, out: &mut dyn fmt::Write) -> Written {
    let Source { gateway, settings, .. } = *source;
    let Some((port, state)) = source.port(row)? else { return NO_ROW };
    let status = StatusText(state.status());
    let is_ethercat_line = settings.ethercat_line().is_some_and(|id| id.index() == row);
    let writer = gateway.ethercat().filter(|_| is_ethercat_line).map(EthercatState::line_writer);
    let writer = writer.filter(|writer| *writer != LineWriter::Settings);
    let mut written = Ok(());
    port.kind.describe(&mut |role, at, line| {
        let line = cell(line);
        let line = line.trim_ascii();
        written = write!(out, "{}\t{role}\t{at}\t{line}\t{status}", port.name);
    });
    let device = state.device().map(Endpoint);
    let written = written.and_then(|()| writer.map_or(Ok(()), |writer| write!(out, ", {writer}")));
    Some(written.and_then(|()| device.map_or(Ok(()), |device| write!(out, ", device {device}"))))
}

fn server(source: &Source<'_, '_>, nth: usize, out: &mut dyn fmt::Write) -> Written {
    let Source { gateway, settings, .. } = *source;
    if !SERVERS {
        return None;
    }
    let ServerSettings { port, units, at, tag } = settings.servers.get(nth)?;
    let status = StatusText(gateway.server_status(nth, None)?);
    let port = settings.name(*port);
    Some(write!(out, "{port}\t{units}\t{tag}\t{at}\t{status}"))
}

fn route(source: &Source<'_, '_>, nth: usize, out: &mut dyn fmt::Write) -> Written {
    let settings = source.settings;
    let route = settings.routes.get(nth)?;
    let row = write!(out, "{}\t{}", nth + 1, Row { settings, route });
    let warn = |warning| write!(out, "  # {warning}");
    Some(row.and_then(|()| settings.rule_warning(nth).map_or(Ok(()), warn)))
}

fn unit(source: &Source<'_, '_>, nth: usize, out: &mut dyn fmt::Write) -> Written {
    let Some((port, port_state)) = source.port(nth / UNITS_MAX)? else { return NO_ROW };
    let known = port_state.units(|units| {
        let unit = *units.iter().nth(nth % UNITS_MAX)?;
        Some((unit, units.state(&unit, source.now)))
    });
    let Some((unit, state)) = known else { return NO_ROW };
    let Unit { id, requests, responses, exceptions, timeouts, .. } = unit;
    let last = took((responses > 0).then_some(unit.took_us));
    let (half, most) = (took(unit.times.percentile(50)), took(unit.times.percentile(99)));
    let ((state, advice), errors) = (describe_unit(&unit, state), LineErrors(&unit));
    let gap = if advice.is_empty() || unit.errors().next().is_none() { "" } else { "; " };
    Some(write!(
        out,
        "{}\t{id}\t{state}\t{requests}\t{responses}\t{exceptions}\t{timeouts}\t{last}\t{half}\t{most}\t\
         {errors}{gap}{advice}",
        port.name
    ))
}

fn client(source: &Source<'_, '_>, nth: usize, out: &mut dyn fmt::Write) -> Written {
    let Source { gateway, settings, now } = *source;
    let state = gateway.connections().get(nth)?.state();
    let (Some(port), Some(peer)) = (state.port, state.peer) else { return NO_ROW };
    let port = settings.name(port);
    let peer = Endpoint(peer);
    let (since, quiet) = (age(state.since, now), age(state.last_request, now));
    let (open, requests) = (state.open_requests, state.requests);
    let slot = if state.marked { "reserved" } else { "ordinary" };
    let row = write!(out, "{port}\t{peer}\t{since}\t{quiet}\t{open}\t{requests}\t{slot}");
    let has_role = TLS && !state.role.is_none();
    Some(row.and_then(|()| if has_role { write!(out, ", role {}", state.role.name()) } else { Ok(()) }))
}

/// The counters of all ports, then their last errors, then those of frames.
fn count(source: &Source<'_, '_>, nth: usize, out: &mut dyn fmt::Write) -> Written {
    let Source { gateway, settings, now } = *source;
    let counters = Event::ALL.len();
    if let Some(port) = source.port(nth / counters) {
        let (Some((port, state)), Some(event)) = (port, Event::ALL.get(nth % counters)) else {
            return NO_ROW;
        };
        let count = state.stats.get(*event);
        // Events that never happened are left out.
        if count == 0 && !matches!(event, Event::Request | Event::Response) {
            return NO_ROW;
        }
        let (event, rate) = (event.name(), state.stats.per_minute(*event, now));
        return Some(write!(out, "{}\t{event}\t{count}\t{rate}\t", port.name));
    }
    let ports = gateway.ports().len().min(settings.ports.len());
    let row = nth - ports * counters;
    if let Some(port) = source.port(row) {
        let Some((port, state)) = port else { return NO_ROW };
        let error = state.stats.last_error();
        let listens = port.kind.side() == Side::Server && !port.kind.asks_by_itself();
        if error == LastError::None || !(listens || matches!(port.kind, PortKind::Serial(_))) {
            return NO_ROW;
        }
        let (code, name) = (error as u8, error.name());
        return Some(write!(out, "{}\tlast-error\t{code}\t\t{name}", port.name));
    }
    let pool = gateway.pool();
    let (name, count) = match row - ports {
        0 => ("frames-free", pool.free()),
        1 => ("frames", pool.capacity()),
        _ => return None,
    };
    Some(write!(out, "-\t{name}\t{count}\t\t"))
}

/// Messages of the board and its controller, then the transactions from the oldest on.
fn event(source: &Source<'_, '_>, system: &dyn System, place: usize, out: &mut dyn fmt::Write) -> Written {
    let Source { gateway, settings, .. } = *source;
    if let Some(event) = system.write_event(place, out) {
        return Some(event);
    }
    let is_event = |n: &usize| system.write_event(*n, &mut Nowhere).is_some();
    let mut row = place - (0..place).take_while(is_event).count();
    if let Some(fault) = gateway.ethercat_controller(settings).and_then(Controller::fault) {
        if row == 0 {
            return Some(write!(out, "EtherCAT: {fault}"));
        }
        row -= 1;
    }
    titled(LOG, row, out, |nth, out| transaction(source, nth, out))
}

/// Transaction `nth`, from the oldest on.
fn transaction(source: &Source<'_, '_>, nth: usize, out: &mut dyn fmt::Write) -> Written {
    let Source { gateway, settings, now } = *source;
    let Some(entry) = gateway.log().newest(LOG_ENTRIES_MAX.checked_sub(nth + 1)?) else { return NO_ROW };
    let age = age(entry.at, now);
    Some(write!(out, "{age}\t{}", LogRow { settings, entry }))
}
