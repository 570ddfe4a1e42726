//! Settings as lines that recreate them: the board's network, then ports, rules in their order, devices, points and slaves.

use core::fmt::{self, Display, Write};

use embassy_time::Duration;
use heapless::String;

use super::points::PointWords;
use super::values::Time;
use super::{
    Driver, Framing, IpPrefix, LineSettings, OwnNetwork, Parity, Port, PortKind, SerialClientSettings,
    SerialServerSettings, SerialSettings, Settings, Side, Special, TcpServerSettings, UnitPolicy,
};
use crate::route::{AddressRange, Cut, Functions, Merge, Policy, Priority, Route, Tag, UnitRange};

/// Longest baud rate and character format.
pub const SPEED_BYTES_MAX: usize = 16;

/// Writes line `n` (from 0) of the settings without its line end; `None` behind the last line.
///
/// A line has every value that differs from the default, and always the baud rate and format.
pub fn write_line(settings: &Settings, n: usize, out: &mut dyn Write) -> Option<fmt::Result> {
    let own_network = usize::from(settings.network != OwnNetwork::DEFAULT);
    let Some(n) = n.checked_sub(own_network) else {
        return Some(write!(out, "network {}", settings.network));
    };
    let ports = || settings.ports.iter().flatten();
    let width = ports().map(|port| port.name.len()).max().unwrap_or(0);
    match ports().nth(n) {
        Some(port) => Some(write_port(port, width, out)),
        None => {
            let n = n.checked_sub(ports().count())?;
            match settings.routes.get(n) {
                Some(route) => Some(write_route(settings, route, width, out)),
                None => write_points(settings, n - settings.routes.len(), out),
            }
        }
    }
}

/// Devices, then points, then slaves.
fn write_points(settings: &Settings, n: usize, out: &mut dyn Write) -> Option<fmt::Result> {
    if let Some(device) = settings.devices.get(n) {
        return Some(write!(out, "{device}"));
    }
    let width = settings.points.iter().map(|point| point.name.len()).max().unwrap_or(0);
    let n = n.checked_sub(settings.devices.len())?;
    if let Some(point) = settings.points.get(n) {
        return Some(write!(out, "point {:width$} {}", point.name, PointWords { settings, point }));
    }
    let n = n.checked_sub(settings.points.len())?;
    Some(write!(out, "slave {n} {}", settings.slaves.get(n)?))
}

fn write_port(port: &Port, width: usize, out: &mut dyn Write) -> fmt::Result {
    write!(out, "port {:width$} {}{}", port.name, port.kind, port.units)
}

/// The words of a port about special unit ids, each with a blank before it; nothing for what is the default.
impl Display for UnitPolicy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let changed = |special| special != Special::default();
        option(f, "broadcast", self.broadcast, changed(self.broadcast))?;
        if self.confirm {
            f.write_str(" confirm-broadcast")?;
        }
        option(f, "unit-255", self.unit_255, changed(self.unit_255))?;
        option(f, "reserved-units", self.reserved, changed(self.reserved))
    }
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
    write!(out, "{}", route.policy)
}

/// The words behind a rule's columns, each with a blank before it; nothing for what is the default.
impl Display for Policy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let default = Self::default();
        match self.functions {
            Functions::ALL => {}
            Functions::READ_ONLY => f.write_str(" readonly")?,
            functions => write!(f, " functions {functions}")?,
        }
        option(f, "addresses", self.addresses, self.addresses != default.addresses)?;
        option(f, "writes", self.writes, self.writes != default.writes)?;
        option(f, "priority", self.priority, self.priority != default.priority)?;
        option(f, "urgent", self.urgent, self.urgent != default.urgent)?;
        option(f, "merge", self.sharing.merge, self.sharing.merge != default.sharing.merge)?;
        option(f, "cache", Time(self.sharing.cache()), self.sharing.cache_ms != default.sharing.cache_ms)?;
        option(f, "cut", self.cut, self.cut != default.cut)
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

impl Display for Cut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Auto => "auto",
            Self::On => "on",
            Self::Off => "off",
        })
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

/// The words behind a port's name.
impl Display for PortKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial(settings) => settings.fmt(f),
            Self::TcpServer(settings) => settings.fmt(f),
            Self::TcpClient(settings) => settings.fmt(f),
            Self::UdpServer(settings) => settings.fmt(f),
            Self::Scanner => f.write_str("scanner"),
            Self::Ethercat(settings) => settings.fmt(f),
        }
    }
}

impl Display for SerialSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { device, framing, side, line, client, server } = self;
        write!(f, "serial {device} {framing} {side} {line}")?;
        if *side == Side::Server {
            let default = SerialServerSettings::DEFAULT;
            let (within, delay) = (server.answer_within, server.reply_delay);
            option(f, "answer-within", Time(within), within != default.answer_within)?;
            return option(f, "reply-delay", Time(delay), delay != default.reply_delay);
        }
        let default = SerialClientSettings::DEFAULT;
        option(f, "timeout", Time(client.timeout), client.timeout != default.timeout)?;
        option(f, "retries", client.retries, client.retries != default.retries)?;
        option(f, "turnaround", Time(client.turnaround), client.turnaround != default.turnaround)?;
        option(f, "start-delay", Time(client.start_delay), client.start_delay != default.start_delay)?;
        if let Some(window) = client.late_window {
            option(f, "late-window", Time(window), true)?;
        }
        option(f, "down-after", client.down_after, client.down_after != default.down_after)
    }
}

impl Display for LineSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.speed())?;
        for (keyword, time) in [("char-timeout", self.char_timeout), ("gap", self.gap)] {
            if let Some(time) = time {
                option(f, keyword, Time(time), true)?;
            }
        }
        match self.driver {
            Driver::Automatic => {}
            Driver::Rs485 => f.write_str(" rs485")?,
            Driver::Rts => f.write_str(" rts")?,
        }
        let zero = Duration::from_ticks(0);
        option(f, "driver-before", Time(self.driver_before), self.driver_before != zero)?;
        option(f, "driver-after", Time(self.driver_after), self.driver_after != zero)?;
        if self.echo { f.write_str(" echo") } else { Ok(()) }
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
        // It has room for the highest baud rate there is.
        let _ = write!(speed, "{baud} {data_bits}{parity}{stop_bits}");
        speed
    }
}

impl Display for TcpServerSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut default = Self::new(self.listen.port);
        default.clients = default.clients_of(self.framing);
        write!(f, "tcp server {}{}", self.listen, self.framing)?;
        option(f, "clients", self.clients, self.clients != default.clients)?;
        option(f, "idle", Time(self.idle), self.idle != default.idle)?;
        option(f, "pipeline", self.pipeline, self.pipeline != default.pipeline)?;
        option(f, "lifetime", Time(self.lifetime), self.lifetime != default.lifetime)?;
        option(f, "reserve", self.reserved, self.reserved != 0)?;
        list(f, " for ", &self.reserved_for)?;
        list(f, " allow ", &self.allowed.0)
    }
}

pub(super) fn list(f: &mut fmt::Formatter<'_>, first: &str, prefixes: &[IpPrefix]) -> fmt::Result {
    for (nth, prefix) in prefixes.iter().enumerate() {
        write!(f, "{}{prefix}", if nth == 0 { first } else { "," })?;
    }
    Ok(())
}

pub(super) fn option(
    f: &mut fmt::Formatter<'_>,
    keyword: &str,
    value: impl Display,
    print: bool,
) -> fmt::Result {
    if print { write!(f, " {keyword} {value}") } else { Ok(()) }
}

impl Display for Framing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Rtu => "rtu",
            Self::Ascii => "ascii",
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
        let mut text = String::<6>::new();
        match *self {
            Self::Keep => text.write_str("*"),
            Self::Shift(by) => write!(text, "{by:+}"),
            Self::Set(unit) => write!(text, "={unit}"),
        }?;
        f.pad(&text)
    }
}

/// `3,4,16` with ranges for three codes and more in a row: `1-6,15`.
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
        Ok(())
    }
}

impl Display for Priority {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::High => "high",
            Self::Normal => "normal",
            Self::Low => "low",
        })
    }
}
