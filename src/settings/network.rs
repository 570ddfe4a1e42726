//! Settings of the ports that speak over a network: TCP servers and clients, UDP servers.

use core::net::IpAddr;

use embassy_time::Duration;
use heapless::Vec;

use crate::settings::{Allowed, Prefixes, Proofs, SOCKETS_MAX, ServerAddress};

/// TCP port number of Modbus (Messaging on TCP/IP 4.3.1.1).
pub const MODBUS_TCP_PORT: u16 = 502;

/// Where a TCP or UDP server listens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TcpListen {
    /// The local address; `None` is all of them.
    pub address: Option<IpAddr>,
    /// TCP or UDP port number, 1 to 65535.
    pub port: u16,
}

impl TcpListen {
    /// Whether a system would refuse to open both: the same port at the same address, or at all addresses.
    pub fn collides(&self, other: &Self) -> bool {
        let all = |listen: &Self| listen.address.is_none_or(|address| address.is_unspecified());
        self.port == other.port && (all(self) || all(other) || self.address == other.address)
    }
}

/// What a TCP stream carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StreamFraming {
    /// Modbus TCP: the MBAP header says where a frame ends and which request a response belongs to.
    #[default]
    Mbap,
    /// RTU over TCP: the bytes of a serial line with their CRC, as serial device servers carry them. One request at a time.
    Rtu,
    /// No requests, but the frames of all ports as they come, as a PCAPNG file. Servers only.
    Capture,
}

/// Requests that one UDP server can have open in all.
pub const UDP_REQUESTS_MAX: usize = 32;

/// A listener for Modbus TCP clients.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TcpServerSettings {
    /// Where it listens.
    pub listen: TcpListen,
    /// Modbus TCP, RTU over TCP, or a capture.
    pub framing: StreamFraming,
    /// Connections at a time, one of a capture unless set. One more is accepted for a moment, to decide who goes.
    pub clients: u16,
    /// A connection without a request for so long is closed; zero never.
    pub idle: Duration,
    /// Requests of one connection that may be open at a time; one more is answered 06h. 1 to 16; with RTU over TCP it is one,
    /// and the next waits.
    pub pipeline: u8,
    /// A request not yet on the wire after this time is not sent any more, and answered 0Bh.
    pub lifetime: Duration,
    /// Of `clients`, places kept for `reserved_for`.
    pub reserved: u16,
    /// When all are taken a newcomer is closed, and not the connection that has been idle for longest.
    pub refuses: bool,
    /// Peers that may use the reserved places and are never closed to make room.
    pub reserved_for: Prefixes,
    /// Peers that may connect; others are closed at once. Empty: everybody may (Messaging on TCP/IP 4.2.3, restricted mode).
    pub allowed: Allowed,
}

impl TcpServerSettings {
    /// A listener on `port` with the defaults: 16 clients, a minute idle, 16 requests each, 5 s of life.
    pub fn new(port: u16) -> Self {
        Self {
            listen: TcpListen { address: None, port },
            framing: StreamFraming::Mbap,
            clients: 16,
            idle: Duration::from_secs(60),
            pipeline: 16,
            lifetime: Duration::from_secs(5),
            reserved: 0,
            refuses: false,
            reserved_for: Vec::new(),
            allowed: Allowed::everybody(),
        }
    }

    /// How many clients there may be unless that is set.
    pub(crate) const fn clients_of(&self, framing: StreamFraming) -> u16 {
        match framing {
            StreamFraming::Mbap | StreamFraming::Rtu => 16,
            StreamFraming::Capture => 1,
        }
    }
}

/// A listener for Modbus UDP clients.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UdpServerSettings {
    /// Where it listens, by UDP.
    pub listen: TcpListen,
    /// Requests of one peer that may be open at a time; one more is answered 06h. 1 to 16.
    pub pipeline: u8,
    /// Requests of all peers that may be open at a time; one more is answered 06h. 1 to [`UDP_REQUESTS_MAX`].
    pub requests: u8,
    /// A request not yet on the wire after this time is not sent any more, and answered 0Bh.
    pub lifetime: Duration,
    /// Peers that may ask; datagrams of others are dropped.
    pub allowed: Allowed,
}

impl UdpServerSettings {
    /// A listener on `listen` with the defaults: 16 requests of a peer, 32 in all, 5 s of life.
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

/// A device, or a gateway with devices behind it, that is asked over TCP.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TcpClientSettings {
    /// Where it listens; none: the port has several servers, in lines of their own.
    pub server: Option<ServerAddress>,
    /// Connections to several servers at a time.
    pub sockets: u8,
    /// Modbus TCP or RTU over TCP.
    pub framing: StreamFraming,
    /// The unit id that is sent whatever the rule says; `None` sends the rule's.
    pub unit: Option<u8>,
    /// Requests that may be open at a time, 1 to 16; 1 with RTU over TCP.
    pub in_flight: u8,
    /// From a request to its response.
    pub timeout: Duration,
    /// From the first try to the open connection.
    pub connect_timeout: Duration,
    /// Pause between the opening of the connection and the first request.
    pub connect_delay: Duration,
    /// Pause between whatever was sent or received last and a request.
    pub request_delay: Duration,
    /// A connection without a request for so long is closed, and opened when the next request comes; zero: it is opened at
    /// once and kept.
    pub idle: Duration,
    /// Repeats of a read that got no response. Writes are never repeated.
    pub retries: u8,
    /// How long after a time-out its response may still come, by its transaction id; with RTU over TCP as at a serial line.
    /// `None`: `timeout`.
    pub late_window: Option<Duration>,
    /// Time-outs in a row after which a unit counts as down and fails at once; 0 never.
    pub down_after: u8,
    /// What proves that a unit is in step; with RTU over TCP.
    pub proofs: Proofs,
}

impl TcpClientSettings {
    /// Modbus TCP to `server`: one request at a time, 1 s for a response, 3 s to connect, closed after a minute, no repeats,
    /// down after three time-outs; to several servers 8 connections at a time, where there can be so many.
    pub fn new(server: Option<ServerAddress>) -> Self {
        Self {
            server,
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
        }
    }

    /// How long after a time-out its response may still come.
    pub fn late_window(&self) -> Duration {
        self.late_window.unwrap_or(self.timeout)
    }
}
