//! Prints settings as the lines that recreate them: users, network, discovery, syslog, time, certificates, publishers, ports, servers, rules in order, devices, points
//! and slaves.

use core::fmt::{self, Display, Write};

use heapless::String;

use super::option::option;
use super::points::PointWords;
use super::port_keys::UNIT_KEYS;
// As what uses it.
#[cfg(feature = "mqtt")]
use super::publish::PublisherWords;
use super::route_words::IDENTIFICATION;
use super::users::KEY_TYPE;
use crate::scanner::POINTS;
use crate::settings::{
    AUDIT, AddressRange, Framing, Functions, LineSettings, Mdns, Merge, Parity, Policy, Port, Route, SERVERS,
    SSH, Settings, Side, Special, StreamFraming, TLS, Tag, Time, USERS, UnitPolicy, UnitRange,
};

/// Longest baud rate and character format.
const SPEED_BYTES_MAX: usize = 16;

/// Writes line `n` (from 0) of the settings, without line end; `None` after the last line.
///
/// A line contains every value that differs from its default, and always the baud rate and format. The lines of users have the
/// hashes of their passwords.
pub fn write_line(settings: &Settings, n: usize, out: &mut dyn Write) -> Option<fmt::Result> {
    write_shown_line(settings, n, Shown::WithSecrets, out)
}

/// What is shown of the settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shown {
    WithSecrets,
    WithoutSecrets,
    /// Without secrets, and each line by itself: names are not aligned with those of other lines.
    Apart,
}

/// The same with or without secrets.
pub(crate) fn write_shown_line(
    settings: &Settings,
    n: usize,
    shown: Shown,
    out: &mut dyn Write,
) -> Option<fmt::Result> {
    let n = match write_user(settings, n, shown, out) {
        Ok(written) => return Some(written),
        Err(n) => n,
    };
    let n = match &settings.network {
        Some(network) if n == 0 => return Some(write!(out, "network {network}")),
        Some(_) => n - 1,
        None => n,
    };
    let n = match &settings.mdns {
        mdns if *mdns == Mdns::DEFAULT => n,
        mdns if n == 0 => return Some(write!(out, "mdns {mdns}")),
        _ => n - 1,
    };
    let n = match settings.syslog.first().filter(|_| AUDIT) {
        Some(syslog) if n == 0 => return Some(write!(out, "syslog {syslog}")),
        Some(_) => n - 1,
        None => n,
    };
    let n = match settings.ntp.first().filter(|_| AUDIT) {
        Some(server) if n == 0 => return Some(write!(out, "ntp {server}")),
        Some(_) => n - 1,
        None => n,
    };
    let n = match write_of_servers(settings, n, shown, out) {
        Ok(written) => return Some(written),
        Err(n) => n,
    };
    let ports = || settings.ports.iter().flatten();
    let widest = || ports().map(|port| port.name.len()).max().unwrap_or(0);
    let width = if shown == Shown::Apart { 0 } else { widest() };
    match ports().nth(n) {
        Some(port) => Some(write_port(port, width, out)),
        None => {
            let n = n.checked_sub(ports().count())?;
            if let Some(server) = settings.servers.get(n).filter(|_| SERVERS) {
                return Some(write!(out, "server {:width$} {server}", settings.name(server.port)));
            }
            let n = n.checked_sub(settings.servers.len())?;
            match settings.routes.get(n) {
                Some(route) => Some(write_route(settings, route, width, out)),
                None => write_points(settings, n - settings.routes.len(), shown, out),
            }
        }
    }
}

/// Certificates, then publishers; the number of the line behind them if `n` is none of theirs.
// Images without TLS, or without publishers, have none.
#[allow(unused_variables)]
fn write_of_servers(
    settings: &Settings,
    n: usize,
    shown: Shown,
    out: &mut dyn Write,
) -> Result<fmt::Result, usize> {
    #[cfg(feature = "tls")]
    let n = match settings.certificates.get(n) {
        Some(certificate) => return Ok(write!(out, "certificate {certificate}")),
        None => n - settings.certificates.len(),
    };
    #[cfg(feature = "mqtt")]
    let n = match settings.publishers.get(n) {
        Some(publisher) => {
            let secrets = shown == Shown::WithSecrets;
            return Ok(write!(out, "publish {}", PublisherWords { publisher, secrets }));
        }
        None => n - settings.publishers.len(),
    };
    Err(n)
}

/// Users, each with the public keys behind; the number of the line behind them if `n` is none of theirs.
fn write_user(
    settings: &Settings,
    mut n: usize,
    shown: Shown,
    out: &mut dyn Write,
) -> Result<fmt::Result, usize> {
    for user in settings.users.iter().filter(|_| USERS) {
        if n == 0 {
            return Ok(match &user.password {
                Some(password) if shown == Shown::WithSecrets => {
                    write!(out, "user {user} password \"{password}\"")
                }
                _ => write!(out, "user {user}"),
            });
        }
        n -= 1;
        if let Some(key) = user.keys.get(n).filter(|_| SSH) {
            return Ok(write!(out, "user {} key {KEY_TYPE} {key}", user.name));
        }
        n -= user.keys.len();
    }
    Err(n)
}

/// Devices, then points, then slaves.
fn write_points(settings: &Settings, n: usize, shown: Shown, out: &mut dyn Write) -> Option<fmt::Result> {
    if !POINTS {
        return None;
    }
    if let Some(device) = settings.devices.get(n) {
        return Some(write!(out, "{device}"));
    }
    let widest = || settings.points.iter().map(|point| point.name.len()).max().unwrap_or(0);
    let width = if shown == Shown::Apart { 0 } else { widest() };
    let n = n.checked_sub(settings.devices.len())?;
    if let Some(point) = settings.points.get(n) {
        return Some(write!(out, "point {:width$} {}", point.name, PointWords { settings, point }));
    }
    let n = n.checked_sub(settings.points.len())?;
    Some(write!(out, "slave {n} {}", settings.slaves.get(n)?))
}

fn write_port(port: &Port, width: usize, out: &mut dyn Write) -> fmt::Result {
    write!(out, "port {:width$} {}", port.name, Behind(port))
}

impl Display for Special {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Rules => f.write_str("rules"),
            Self::Off => f.write_str("off"),
            Self::Local => f.write_str("local"),
            Self::Replace(unit) => write!(f, "replace {unit}"),
            Self::AllLines => f.write_str("all"),
        }
    }
}

fn write_route(settings: &Settings, route: &Route, width: usize, out: &mut dyn Write) -> fmt::Result {
    write!(out, "route {:width$} {:7} ", settings.name(route.source), route.units)?;
    match route.peer {
        Some(peer) => write!(out, "{peer} ")?,
        None => write!(out, "* ")?,
    }
    write!(out, "{} {}", route.tag, settings.destination(route.destination))?;
    if TLS && !route.role.is_none() {
        write!(out, " role {}", route.role.name())?;
    }
    write!(out, "{}", route.policy)
}

/// The words after a rule's columns, each preceded by a blank; defaults are omitted.
impl Display for Policy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let default = Self::default();
        match self.functions {
            Functions::ALL => {}
            Functions::READ_ONLY => f.write_str(" readonly")?,
            functions => write!(f, " functions {functions}")?,
        }
        option(f, "addresses", &self.addresses, self.addresses != default.addresses)?;
        option(f, "writes", &self.writes, self.writes != default.writes)?;
        option(f, "forbidden", &self.forbidden, self.forbidden != default.forbidden)?;
        option(f, "priority", &self.priority, self.priority != default.priority)?;
        option(f, "urgent", &self.urgent, self.urgent != default.urgent)?;
        option(f, "merge", &self.sharing.merge, self.sharing.merge != default.sharing.merge)?;
        option(f, "cache", &Time(self.sharing.cache()), self.sharing.cache_ms != default.sharing.cache_ms)?;
        option(f, "cut", &self.cut, self.cut != default.cut)
    }
}

impl Display for Merge {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Off => f.write_str("off"),
            Self::Identical => f.write_str("on"),
            Self::Near(0) => f.write_str("adjacent"),
            Self::Near(gap) => write!(f, "near {gap}"),
        }
    }
}

impl Display for AddressRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.first == self.last {
            write!(f, "{}", self.first)
        } else {
            write!(f, "{}-{}", self.first, self.last)
        }
    }
}

/// The words after a port's name: its kind and address, then what differs from the defaults.
struct Behind<'p>(&'p Port);

impl Display for Behind<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Port { kind, units, .. } = self.0;
        kind.write_begin(f)?;
        let (mut own, mut default) = (kind.clone(), kind.plain());
        let (mut own_units, mut default_units) = (*units, UnitPolicy::default());
        let (keys, _) = kind.words();
        for &(keyword, key) in keys.iter().chain(UNIT_KEYS) {
            let own = own.field(key).or_else(|| own_units.field(key));
            let default = default.field(key).or_else(|| default_units.field(key));
            if let (Some(own), Some(default)) = (own, default) {
                own.write(&default, keyword, f)?;
            }
        }
        Ok(())
    }
}

impl LineSettings {
    /// Baud rate and character format: `19200 8E1`.
    pub fn speed(&self) -> String<SPEED_BYTES_MAX> {
        let Self { baud, data_bits, parity, stop_bits, .. } = *self;
        let parity = match parity {
            Parity::None => 'N',
            Parity::Even => 'E',
            Parity::Odd => 'O',
        };
        let mut speed = String::new();
        // Fits the highest baud rate.
        let _ = write!(speed, "{baud} {data_bits}{parity}{stop_bits}");
        speed
    }
}

impl Display for Framing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Rtu => "rtu",
            Self::Ascii => "ascii",
        })
    }
}

/// The framing after the address.
impl Display for StreamFraming {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Mbap | Self::Ssh => "",
            Self::Rtu => " rtu",
            Self::Capture => " capture",
        })
    }
}

impl Display for Side {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Client => "client",
            Self::Server => "server",
        })
    }
}

impl Display for UnitRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut text = String::<7>::new();
        match *self {
            Self::ALL => text.write_str("*"),
            Self { first, last } if first == last => write!(text, "{first}"),
            Self { first, last } => write!(text, "{first}-{last}"),
        }?;
        f.pad(&text)
    }
}

impl Display for Tag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Keep => f.write_str("*"),
            Self::Add(by) => write!(f, "+{by}"),
            Self::Subtract(by) => write!(f, "-{by}"),
            Self::Set(unit) => write!(f, "={unit}"),
        }
    }
}

/// `3,4,16`, with ranges for three codes and more in a row: `1-6,15`; `43/14` is last.
impl Display for Functions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (mut code, mut separator) = (1, "");
        while code <= 127 {
            let first = code;
            while code <= 127 && self.contains(code) {
                code += 1;
            }
            match code - first {
                0 => {
                    code += 1;
                    continue;
                }
                1 => write!(f, "{separator}{first}")?,
                2 => write!(f, "{separator}{first},{}", code - 1)?,
                _ => write!(f, "{separator}{first}-{}", code - 1)?,
            }
            separator = ",";
        }
        if self.contains_identification() { write!(f, "{separator}{IDENTIFICATION}") } else { Ok(()) }
    }
}
