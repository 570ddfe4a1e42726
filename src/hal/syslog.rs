//! The way to a syslog server.

use core::fmt;

use embassy_time::Instant;

use super::OpenError;
use crate::settings::Syslog;

/// Reaches syslog servers.
pub trait SyslogHost {
    /// A way to a server.
    type Link<'a>: SyslogLink
    where
        Self: 'a;

    /// Opens a way to the server of `syslog`. The caller limits the time by dropping the pending future.
    async fn open(&mut self, syslog: &Syslog) -> Result<Self::Link<'_>, OpenError>;
}

/// An open way to a syslog server: a UDP socket or a TCP connection.
pub trait SyslogLink {
    /// Waits until the server is known to be unreachable. Its messages are ignored.
    async fn ended(&mut self) -> OpenError;

    /// Sends `bytes`: as one datagram, or as the next ones of a stream.
    async fn send(&mut self, bytes: &[u8]) -> Result<(), OpenError>;

    /// Writes the name of this machine: visible characters of ASCII, at most 255.
    fn write_host_name(&self, out: &mut dyn fmt::Write) -> fmt::Result;

    /// The number of the program, where there are several.
    fn process(&self) -> Option<u32> {
        None
    }

    /// Writes the date of `at` with microseconds, as RFC 3339 has it; `None` on boards without a calendar.
    fn write_date(&self, _at: Instant, _out: &mut dyn fmt::Write) -> Option<fmt::Result> {
        None
    }
}
