//! The words of the network ports: `tcp client 192.168.1.20:502 in-flight 4 timeout 300ms`.

use core::fmt::{self, Display};
use core::net::{IpAddr, SocketAddr};
use core::ops::RangeInclusive;

use embassy_time::Duration;

use super::port_keys::{
    DOWN_AFTER, Key, LATE_WINDOW, LIFETIME, PIPELINE, RETRIES, TIMEOUT, allowed, auto_or_time, idle,
};
use super::print::{list, option};
use super::values::{Time, listen, small, time};
use super::words::{Word, Words, Wrong};
use super::{MODBUS_TCP_PORT, StreamFraming, TcpClientSettings, UDP_REQUESTS_MAX, UdpServerSettings};

const DELAY: RangeInclusive<Duration> = Duration::from_ticks(0)..=Duration::from_secs(60);

pub(super) const TCP_CLIENT_KEYS: &[(&str, Key)] = &[
    ("address", Key::Server),
    ("rtu", Key::Stream(StreamFraming::Rtu)),
    // For `edit`: the flag has no value that could say so.
    ("mbap", Key::Stream(StreamFraming::Mbap)),
    ("unit", Key::Unit),
    ("in-flight", Key::InFlight),
    ("timeout", Key::Timeout),
    ("connect-timeout", Key::ConnectTimeout),
    ("connect-delay", Key::ConnectDelay),
    ("request-delay", Key::RequestDelay),
    ("idle", Key::Idle),
    ("retries", Key::Retries),
    ("late-window", Key::LateWindow),
    ("down-after", Key::DownAfter),
];

pub(super) const TCP_CLIENT_EXPECTED: &str = "address, rtu, unit, in-flight, timeout, connect-timeout, \
     connect-delay, request-delay, idle, retries, late-window or down-after";

/// Sets in a TCP client what `key` says.
pub(super) fn set_tcp_client(settings: &mut TcpClientSettings, key: Key, words: &Words) -> Result<(), Wrong> {
    if let Key::Stream(framing) = key {
        settings.framing = framing;
        return Ok(());
    }
    let value = words.take();
    match key {
        Key::Server => settings.server = server(value)?,
        Key::Unit if value.is("auto") => settings.unit = None,
        Key::Unit => settings.unit = Some(small(value, "auto, or a unit id", 0..=255)?),
        Key::InFlight => settings.in_flight = small(value, "requests", PIPELINE)?,
        Key::Timeout => settings.timeout = time(value, TIMEOUT)?,
        Key::ConnectTimeout => settings.connect_timeout = time(value, TIMEOUT)?,
        Key::ConnectDelay => settings.connect_delay = time(value, DELAY)?,
        Key::RequestDelay => settings.request_delay = time(value, DELAY)?,
        Key::Idle => settings.idle = idle(value)?,
        Key::Retries => settings.retries = small(value, "retries", RETRIES)?,
        Key::LateWindow => settings.late_window = auto_or_time(value, LATE_WINDOW)?,
        Key::DownAfter => settings.down_after = small(value, "time-outs in a row", DOWN_AFTER)?,
        _ => return Err(value.expected(TCP_CLIENT_EXPECTED)),
    }
    Ok(())
}

pub(super) const UDP_SERVER_KEYS: &[(&str, Key)] = &[
    ("listen", Key::Listen),
    ("pipeline", Key::Pipeline),
    ("requests", Key::Requests),
    ("lifetime", Key::Lifetime),
    ("allow", Key::Allow),
];

pub(super) const UDP_SERVER_EXPECTED: &str = "listen, pipeline, requests, lifetime or allow";

/// Sets in a UDP server what `key` says.
pub(super) fn set_udp_server(settings: &mut UdpServerSettings, key: Key, words: &Words) -> Result<(), Wrong> {
    if key == Key::Allow {
        settings.allowed = allowed(words)?;
        return Ok(());
    }
    let value = words.take();
    match key {
        Key::Listen => settings.listen = listen(value)?,
        Key::Pipeline => settings.pipeline = small(value, "requests", PIPELINE)?,
        Key::Requests => settings.requests = small(value, "requests", 1..=UDP_REQUESTS_MAX as u8)?,
        Key::Lifetime => settings.lifetime = time(value, LIFETIME)?,
        _ => return Err(value.expected(UDP_SERVER_EXPECTED)),
    }
    Ok(())
}

impl Display for UdpServerSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let default = Self::new(self.listen);
        write!(f, "udp server {}", self.listen)?;
        option(f, "pipeline", self.pipeline, self.pipeline != default.pipeline)?;
        option(f, "requests", self.requests, self.requests != default.requests)?;
        option(f, "lifetime", Time(self.lifetime), self.lifetime != default.lifetime)?;
        list(f, " allow ", &self.allowed.0)
    }
}

/// Where a server is: `192.168.1.20:502`, `[fe80::1]:502`; without a port number it is Modbus's own.
pub(super) fn server(word: Word) -> Result<SocketAddr, Wrong> {
    let parsed = word.text.parse().ok().or_else(|| {
        let address: IpAddr = word.text.parse().ok()?;
        Some(SocketAddr::new(address, MODBUS_TCP_PORT))
    });
    // An IPv6 zone would not be printed in the same way on every system.
    let plain = |server: &SocketAddr| match server {
        SocketAddr::V4(_) => true,
        SocketAddr::V6(server) => server.scope_id() == 0 && server.flowinfo() == 0,
    };
    parsed
        .filter(|server| server.port() != 0 && !server.ip().is_unspecified() && plain(server))
        .ok_or_else(|| word.expected("the address of a server such as 192.168.1.20 or 192.168.1.20:502"))
}

/// What stands behind the address.
impl Display for StreamFraming {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Mbap => Ok(()),
            Self::Rtu => f.write_str(" rtu"),
            Self::Capture => f.write_str(" capture"),
        }
    }
}

impl Display for TcpClientSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let default = Self::new(self.server);
        write!(f, "tcp client {}{}", self.server, self.framing)?;
        if let Some(unit) = self.unit {
            option(f, "unit", unit, true)?;
        }
        option(f, "in-flight", self.in_flight, self.in_flight != default.in_flight)?;
        for (keyword, time, default) in [
            ("timeout", self.timeout, default.timeout),
            ("connect-timeout", self.connect_timeout, default.connect_timeout),
            ("connect-delay", self.connect_delay, default.connect_delay),
            ("request-delay", self.request_delay, default.request_delay),
            ("idle", self.idle, default.idle),
        ] {
            option(f, keyword, Time(time), time != default)?;
        }
        option(f, "retries", self.retries, self.retries != default.retries)?;
        if let Some(window) = self.late_window {
            option(f, "late-window", Time(window), true)?;
        }
        option(f, "down-after", self.down_after, self.down_after != default.down_after)
    }
}
