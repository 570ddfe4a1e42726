//! Sends the audit trail to a syslog server, as messages of RFC 5424, by UDP (RFC 5426) or TCP (RFC 6587).
//!
//! The trail itself is the queue. Lines overwritten before they were sent leave a gap in the numbers, and a message tells the server how
//! many were lost. Each message carries its number as `sequenceId`, so a server also notices lost messages.

use core::convert::Infallible;
use core::fmt::Write as _;

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Timer, with_timeout};
use heapless::String;

use crate::gateway::audit::{loss, message};
use crate::gateway::{Gateway, Status};
use crate::hal::{OpenError, OpenErrorKind, SyslogHost, SyslogLink};
use crate::settings::{Syslog, Transport};

/// Time limit of a connection, and of a message on it.
const CONNECT_MAX: Duration = Duration::from_secs(10);
const SEND_MAX: Duration = Duration::from_secs(30);
/// First and longest pause before another attempt.
const PAUSE_FIRST: Duration = Duration::from_secs(1);
const PAUSE_MAX: Duration = Duration::from_secs(30);

const SLOW: OpenError = OpenError::new(OpenErrorKind::TimedOut, "the server reads nothing");

impl Gateway<'_> {
    /// Sends the audit trail to the syslog server in the settings, if there is one, over `host`; never returns.
    pub async fn forward_audit(&self, host: &mut impl SyslogHost) {
        loop {
            match self.settings(|settings| settings.syslog().cloned()) {
                Some(syslog) => _ = select(forward(self, host, &syslog), self.new_syslog()).await,
                None => self.new_syslog().await,
            }
            self.change_forwarding(|forwarding| forwarding.status = Status::Off);
        }
    }
}

/// Sends to one server.
async fn forward(gateway: &Gateway<'_>, host: &mut impl SyslogHost, syslog: &Syslog) -> Infallible {
    let mut pause = PAUSE_FIRST;
    loop {
        let before = gateway.forwarding().sent;
        let Err(error) = with_link(gateway, host, syslog).await;
        if gateway.forwarding().status != Status::Failed(error) {
            log_warn!("syslog {syslog}: {error}");
        }
        gateway.change_forwarding(|forwarding| forwarding.status = Status::Failed(error));
        pause = if gateway.forwarding().sent != before { PAUSE_FIRST } else { (pause * 2).min(PAUSE_MAX) };
        Timer::after(pause).await;
    }
}

/// Connects, and sends until that fails.
async fn with_link(
    gateway: &Gateway<'_>,
    host: &mut impl SyslogHost,
    syslog: &Syslog,
) -> Result<Infallible, OpenError> {
    let connected = with_timeout(CONNECT_MAX, host.open(syslog)).await;
    let mut link = connected.map_err(|_| OpenError::new(OpenErrorKind::TimedOut, ""))??;
    gateway.change_forwarding(|forwarding| forwarding.status = Status::Open);
    loop {
        let (line, lost) = match select(link.ended(), gateway.unsent_audit()).await {
            Either::First(error) => return Err(error),
            Either::Second(unsent) => unsent,
        };
        let loss = (lost > 0).then(|| loss(&link, &line, lost));
        for message in loss.into_iter().chain([message(&link, &line)]) {
            let sent = with_timeout(SEND_MAX, send(&mut link, syslog.transport, &message)).await;
            if let Err(error) = sent.unwrap_or(Err(SLOW)) {
                // The error of the previous datagram, which did not arrive.
                let is_late = syslog.transport == Transport::Udp && error.kind == OpenErrorKind::Refused;
                gateway.change_forwarding(|forwarding| forwarding.lost += u32::from(is_late));
                return Err(error);
            }
        }
        gateway.change_forwarding(|forwarding| {
            forwarding.sent = line.number;
            forwarding.lost += lost;
        });
    }
}

async fn send(link: &mut impl SyslogLink, transport: Transport, message: &str) -> Result<(), OpenError> {
    if transport == Transport::Tcp {
        // Octet counting (RFC 6587, 3.4.1).
        let mut length = String::<8>::new();
        // It fits.
        let _ = write!(length, "{} ", message.len());
        link.send(length.as_bytes()).await?;
    }
    link.send(message.as_bytes()).await
}
