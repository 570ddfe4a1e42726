//! Sends the audit trail to a syslog server, as messages of RFC 5424, by UDP (RFC 5426) or TCP (RFC 6587).
//!
//! The trail itself is the queue: what was pushed out of it before it could be sent is missing in its numbers, is counted, and the server is
//! told how much. Each message has its number as `sequenceId` (RFC 5424, 7.3.1), so that a server sees what else is missing.

use std::convert::Infallible;
use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Timer, with_timeout};
use embedded_io_async::{Read, Write};
use mobgate::gateway::audit::AuditLine;
use mobgate::gateway::{Gateway, Status};
use mobgate::hal::{OpenError, OpenErrorKind, TcpConnect as _};
use mobgate::settings::{Syslog, Transport};
use rustix::io::Errno;
use rustix::system::uname;

use crate::calendar::date;
use crate::descriptor::Descriptor;
use crate::tcp::{Connector, TcpStream, addresses_of, refusal};

/// Facility of an audit trail: "log audit" (RFC 5424, table 1).
const FACILITY: u8 = 13;
/// Severities (RFC 5424, table 2).
const WARNING: u8 = 4;
const NOTICE: u8 = 5;
/// Longest HOSTNAME.
const HOST_NAME_MAX: usize = 255;
/// Time limit of a connection, and of a message on it.
const CONNECT_MAX: Duration = Duration::from_secs(10);
const SEND_MAX: Duration = Duration::from_secs(30);
/// First and longest pause before another attempt.
const PAUSE_FIRST: Duration = Duration::from_secs(1);
const PAUSE_MAX: Duration = Duration::from_secs(30);

const LOST: OpenError = OpenError::new(OpenErrorKind::Failed, "the server has closed the connection");
const SLOW: OpenError = OpenError::new(OpenErrorKind::TimedOut, "the server reads nothing");

/// Sends to the server in the settings of `gateway`, if there is one; never returns.
pub async fn run(gateway: &Gateway<'_>) {
    loop {
        match gateway.settings(|settings| settings.syslog().cloned()) {
            Some(syslog) => _ = select(forward(gateway, &syslog), gateway.new_syslog()).await,
            None => gateway.new_syslog().await,
        }
        gateway.change_forwarding(|forwarding| forwarding.status = Status::Off);
    }
}

/// Sends to one server.
async fn forward(gateway: &Gateway<'_>, syslog: &Syslog) -> Infallible {
    let mut pause = PAUSE_FIRST;
    loop {
        let before = gateway.forwarding().sent;
        let Err(error) = with_link(gateway, syslog).await;
        if gateway.forwarding().status != Status::Failed(error) {
            log::warn!("syslog {syslog}: {error}");
        }
        gateway.change_forwarding(|forwarding| forwarding.status = Status::Failed(error));
        pause = if gateway.forwarding().sent != before { PAUSE_FIRST } else { (2 * pause).min(PAUSE_MAX) };
        Timer::after(pause).await;
    }
}

/// Connects, and sends until that fails.
async fn with_link(gateway: &Gateway<'_>, syslog: &Syslog) -> Result<Infallible, OpenError> {
    let connected = with_timeout(CONNECT_MAX, Link::open(syslog)).await;
    let mut link = connected.map_err(|_| OpenError::new(OpenErrorKind::TimedOut, ""))??;
    gateway.change_forwarding(|forwarding| forwarding.status = Status::Open);
    loop {
        let (line, lost) = match select(link.ended(), gateway.unsent_audit()).await {
            Either::First(error) => return Err(error),
            Either::Second(unsent) => unsent,
        };
        let loss = (lost > 0).then(|| loss(&line, lost));
        for message in loss.into_iter().chain([message(&line)]) {
            let sent = with_timeout(SEND_MAX, link.send(&message)).await;
            if let Err(error) = sent.unwrap_or(Err(SLOW)) {
                // It tells of the datagram before, which has found nobody.
                let unheard = u32::from(matches!(link, Link::Udp(_)) && error.kind == OpenErrorKind::Refused);
                gateway.change_forwarding(|forwarding| forwarding.lost += unheard);
                return Err(error);
            }
        }
        gateway.change_forwarding(|forwarding| {
            forwarding.sent = line.number;
            forwarding.lost += lost;
        });
    }
}

/// A way to the server.
enum Link {
    Udp(Descriptor<UdpSocket>),
    Tcp(TcpStream),
}

impl Link {
    async fn open(Syslog { transport, server }: &Syslog) -> Result<Self, OpenError> {
        if *transport == Transport::Tcp {
            return Connector.connect(server).await.map(Self::Tcp);
        }
        let addresses = addresses_of(server).await?;
        let open = |to: &SocketAddr| {
            let any = if to.is_ipv4() { Ipv4Addr::UNSPECIFIED.into() } else { Ipv6Addr::UNSPECIFIED.into() };
            let socket = UdpSocket::bind(SocketAddr::new(any, 0))?;
            socket.connect(to)?;
            Descriptor::new(socket)
        };
        let first = addresses.first().ok_or(io::Error::from(Errno::HOSTUNREACH));
        first.and_then(open).map(Self::Udp).map_err(|error| refusal(&error))
    }

    /// Waits until the server closes the connection. What it says is ignored.
    async fn ended(&mut self) -> OpenError {
        let Self::Tcp(stream) = self else { return std::future::pending().await };
        loop {
            match stream.read(&mut [0; 64]).await {
                Ok(0) => return LOST,
                Ok(_) => {}
                Err(error) => return refusal(&error),
            }
        }
    }

    async fn send(&mut self, message: &str) -> Result<(), OpenError> {
        let sent = match self {
            Self::Udp(socket) => {
                let sent = socket.write_with(|socket| socket.send(message.as_bytes())).await;
                sent.map(drop)
            }
            Self::Tcp(stream) => {
                // Octet counting (RFC 6587, 3.4.1).
                let framed = format!("{} {message}", message.len());
                stream.write_all(framed.as_bytes()).await
            }
        };
        sent.map_err(|error| refusal(&error))
    }
}

/// A line of the trail as a message.
fn message(line: &AuditLine) -> String {
    let severity = if line.topic.is_refusal() { WARNING } else { NOTICE };
    let data = format!("[meta sequenceId=\"{}\"]", line.number);
    with_header(line, severity, line.topic.name(), &data, &format!("{}: {}", line.actor(), line.what()))
}

/// The message that so many lines before `line` were lost.
fn loss(line: &AuditLine, lost: u32) -> String {
    with_header(line, WARNING, "lost", "-", &format!("gateway: {lost} lines before this one were lost"))
}

fn with_header(line: &AuditLine, severity: u8, id: &str, data: &str, text: &str) -> String {
    let (priority, date, process) = (8 * FACILITY + severity, date(line.at), std::process::id());
    let name = uname();
    let visible = name.nodename().to_bytes().iter().filter(|byte| byte.is_ascii_graphic());
    let host: String = visible.take(HOST_NAME_MAX).map(|byte| char::from(*byte)).collect();
    let host = if host.is_empty() { "-" } else { &host };
    format!("<{priority}>1 {date:.6} {host} mobgate {process} {id} {data} {text}")
}
