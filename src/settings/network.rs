//! Settings of network ports: TCP servers, TCP clients and UDP servers.

use core::net::IpAddr;

use embassy_time::Duration;
use heapless::Vec;

// As the field.
#[cfg(feature = "tls")]
use crate::settings::TlsSettings;
use crate::settings::{Allowed, Prefixes, Proofs, SOCKETS_MAX, SSH, ServerAddress};

/// TCP port number of Modbus (Messaging on TCP/IP 4.3.1.1).
pub(crate) const MODBUS_TCP_PORT: u16 = 502;

/// Where a TCP or UDP server listens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TcpListen {
    /// The local address; `None` means all.
    pub address: Option<IpAddr>,
    /// TCP or UDP port number, 1 to 65535.
    pub port: u16,
}

impl TcpListen {
    /// Whether a system would refuse to open both: the same port at the same address, or one of them at all addresses.
    pub fn collides(&self, other: &Self) -> bool {
        let all = |listen: &Self| listen.address.is_none_or(|address| address.is_unspecified());
        self.port == other.port && (all(self) || all(other) || self.address == other.address)
    }
}

/// The content of a TCP stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StreamFraming {
    /// Modbus TCP: the MBAP header delimits frames and carries the transaction id.
    #[default]
    Mbap,
    /// RTU over TCP: RTU frames with their CRC in a stream, as used by serial device servers. One request at a time.
    Rtu,
    /// The frames of all ports as a PCAPNG stream, and no requests. Servers only.
    Capture,
    /// The console by SSH, and no requests. Servers only.
    Ssh,
}

/// Requests in flight at one UDP server.
pub(crate) const UDP_REQUESTS_MAX: usize = 32;

/// Default number of clients of a TCP server: the board's number of connections.
pub(super) const CLIENTS_DEFAULT: u16 = if cfg!(feature = "eight-clients") { 8 } else { 16 };

/// Default number of clients of an SSH server: a host's sessions, and as many log-ins. Boards have fewer connections.
const SSH_CLIENTS: u16 = if cfg!(feature = "paths") { 16 } else { 4 };

/// A listener for Modbus TCP clients.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TcpServerSettings {
    /// Where it listens.
    pub listen: TcpListen,
    /// Modbus TCP, RTU over TCP, a capture, or SSH.
    pub framing: StreamFraming,
    /// Simultaneous connections; one for a capture unless set. One more is accepted briefly, to decide which is closed.
    pub clients: u16,
    /// A connection without a request for this long is closed; zero: never.
    pub idle: Duration,
    /// Requests in flight per connection, 1 to 16; one more gets 06h. RTU over TCP allows one, and the next waits.
    pub pipeline: u8,
    /// A request not sent within this time is dropped, and answered 0Bh.
    pub lifetime: Duration,
    /// Connections, out of `clients`, reserved for `reserved_for`.
    pub reserved: u16,
    /// When all are taken, a newcomer is refused; otherwise the connection idle longest is closed.
    pub refuses: bool,
    /// Peers that may use the reserved connections, and are never displaced.
    pub reserved_for: Prefixes,
    /// Peers that may connect; others are disconnected at once. Empty: everybody (Messaging on TCP/IP 4.2.3, restricted mode).
    pub allowed: Allowed,
    /// Modbus/TCP Security: clients must show certificates.
    // Left out of images without TLS.
    #[cfg(feature = "tls")]
    pub tls: TlsSettings,
}

impl TcpServerSettings {
    /// A listener on `port` with the defaults: 16 clients (8 with the feature `eight-clients`), closed after a minute idle, 16
    /// requests each, 5 s lifetime.
    pub fn new(port: u16) -> Self {
        Self {
            listen: TcpListen { address: None, port },
            framing: StreamFraming::Mbap,
            clients: CLIENTS_DEFAULT,
            idle: Duration::from_secs(60),
            pipeline: 16,
            lifetime: Duration::from_secs(5),
            reserved: 0,
            refuses: false,
            reserved_for: Vec::new(),
            allowed: Allowed::everybody(),
            // As the field.
            #[cfg(feature = "tls")]
            tls: TlsSettings::OFF,
        }
    }

    /// An SSH server at `listen` with the defaults: 16 clients, 4 on boards.
    pub(crate) fn ssh(listen: TcpListen) -> Self {
        Self { listen, framing: StreamFraming::Ssh, clients: SSH_CLIENTS, ..Self::new(listen.port) }
    }

    /// Whether it is an SSH server.
    pub(crate) const fn is_ssh(&self) -> bool {
        SSH && matches!(self.framing, StreamFraming::Ssh)
    }

    /// The same place with default settings, and as many clients as its framing has by default.
    pub(super) fn plain(&self) -> Self {
        if self.is_ssh() {
            return Self::ssh(self.listen);
        }
        let clients = self.clients_of(self.framing);
        Self { listen: self.listen, clients, ..Self::new(self.listen.port) }
    }

    /// The default number of clients.
    pub(crate) const fn clients_of(&self, framing: StreamFraming) -> u16 {
        match framing {
            StreamFraming::Mbap | StreamFraming::Rtu => CLIENTS_DEFAULT,
            StreamFraming::Capture => 1,
            StreamFraming::Ssh => SSH_CLIENTS,
        }
    }
}

/// A listener for Modbus UDP clients.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UdpServerSettings {
    /// The UDP address and port.
    pub listen: TcpListen,
    /// Requests in flight per peer, 1 to 16; one more gets 06h.
    pub pipeline: u8,
    /// Requests in flight of all peers, 1 to `UDP_REQUESTS_MAX`; one more gets 06h.
    pub requests: u8,
    /// A request not sent within this time is dropped, and answered 0Bh.
    pub lifetime: Duration,
    /// Peers that are allowed; datagrams from others are dropped.
    pub allowed: Allowed,
}

impl UdpServerSettings {
    /// A listener on `listen` with the defaults: 16 requests per peer, 32 in all, 5 s lifetime.
    pub const fn new(listen: TcpListen) -> Self {
        Self {
            listen,
            pipeline: 16,
            requests: UDP_REQUESTS_MAX as u8,
            lifetime: Duration::from_secs(5),
            allowed: Allowed::everybody(),
        }
    }
}

/// Bytes by which a device is told apart.
// Left out of images in which no device connects; also below.
#[cfg(feature = "dial-in")]
pub(crate) const FIRST_BYTES_MAX: usize = 32;

/// What a device sends first.
#[cfg(feature = "dial-in")]
pub(crate) type FirstBytes = Vec<u8, FIRST_BYTES_MAX, u8>;

/// Devices waiting for their first bytes to be complete, of one port; a newcomer displaces the one that has waited for longest.
pub(crate) const DIAL_IN_WAITING_MAX: usize = 4;

/// Where the device of a TCP client connects, and how it is told apart from others that connect there.
#[cfg(feature = "dial-in")]
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct DialIn {
    /// Where the gateway listens; several ports may listen there.
    pub(crate) listen: TcpListen,
    /// The device's addresses.
    pub(crate) allowed: Allowed,
    /// What the device sends first, if anything: not part of a response.
    pub(crate) first: FirstBytes,
}

#[cfg(feature = "dial-in")]
impl DialIn {
    /// Whether a device may be that of both.
    pub(crate) fn overlaps(&self, other: &Self) -> bool {
        let is_prefix = self.first.starts_with(&other.first) || other.first.starts_with(&self.first);
        is_prefix && self.allowed.overlaps(&other.allowed)
    }
}

/// A TCP client: one device or gateway, or several with server lines.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TcpClientSettings {
    /// The server's address; `None`: several servers, with their own lines, or a device that connects to the gateway.
    pub server: Option<ServerAddress>,
    /// The device that connects to the gateway.
    #[cfg(feature = "dial-in")]
    pub(crate) dial_in: Option<DialIn>,
    /// Simultaneous connections, with several servers.
    pub sockets: u8,
    /// Modbus TCP or RTU over TCP.
    pub framing: StreamFraming,
    /// Overrides the unit given by the rule.
    pub unit: Option<u8>,
    /// Requests in flight, 1 to 16; 1 with RTU over TCP.
    pub in_flight: u8,
    /// Response time-out.
    pub timeout: Duration,
    /// Connect time-out.
    pub connect_timeout: Duration,
    /// Pause between connecting and the first request.
    pub connect_delay: Duration,
    /// Pause between the last activity and a request.
    pub request_delay: Duration,
    /// A connection without a request for this long is closed, and opened for the next request; zero: it is opened at once and
    /// kept.
    pub idle: Duration,
    /// Repeats of a read that got no response. Writes are never repeated.
    pub retries: u8,
    /// How long after a time-out its response may still arrive, matched by transaction id; with RTU over TCP as on a serial line.
    /// `None`: `timeout`.
    pub late_window: Option<Duration>,
    /// Time-outs in a row after which a unit is down and requests to it fail at once; 0: never.
    pub down_after: u8,
    /// How units are proved to be in step; with RTU over TCP.
    pub proofs: Proofs,
    /// Modbus/TCP Security: servers must show certificates.
    // Left out of images without TLS.
    #[cfg(feature = "tls")]
    pub tls: TlsSettings,
}

impl TcpClientSettings {
    /// Modbus TCP to `server` with the defaults: one request in flight, 800 ms response time-out, 3 s to connect, closed after a
    /// minute, no repeats, down after three time-outs; for several servers 8 connections, or as many as possible.
    pub fn new(server: Option<ServerAddress>) -> Self {
        Self {
            server,
            #[cfg(feature = "dial-in")]
            dial_in: None,
            sockets: if SOCKETS_MAX < 8 { SOCKETS_MAX as u8 } else { 8 },
            framing: StreamFraming::Mbap,
            unit: None,
            in_flight: 1,
            timeout: Duration::from_millis(800),
            connect_timeout: Duration::from_secs(3),
            connect_delay: Duration::from_ticks(0),
            request_delay: Duration::from_ticks(0),
            idle: Duration::from_secs(60),
            retries: 0,
            late_window: None,
            down_after: 3,
            proofs: Proofs::default(),
            // As the field.
            #[cfg(feature = "tls")]
            tls: TlsSettings::OFF,
        }
    }

    /// The same for a device that connects to `listen`, and is kept.
    #[cfg(feature = "dial-in")]
    pub(crate) fn listening(listen: TcpListen) -> Self {
        let dial_in = DialIn { listen, allowed: Allowed::everybody(), first: Vec::new() };
        Self { dial_in: Some(dial_in), idle: Duration::from_ticks(0), ..Self::new(None) }
    }

    /// Where it listens for its device, if that connects.
    pub const fn listens(&self) -> Option<&TcpListen> {
        #[cfg(feature = "dial-in")]
        if let Some(dial_in) = &self.dial_in {
            return Some(&dial_in.listen);
        }
        None
    }

    /// Whether it has several servers, with their own lines.
    pub(crate) const fn has_lines(&self) -> bool {
        self.server.is_none() && self.listens().is_none()
    }

    /// The same server, or place to listen, with default settings.
    pub(super) fn plain(&self) -> Self {
        #[cfg(feature = "dial-in")]
        if let Some(listen) = self.listens() {
            return Self::listening(*listen);
        }
        Self::new(self.server.clone())
    }

    /// How long after a time-out its response may still arrive.
    pub fn late_window(&self) -> Duration {
        self.late_window.unwrap_or(self.timeout)
    }
}
