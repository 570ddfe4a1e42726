//! The envelope: the properties of a frame besides its PDU, such as requester, unit, deadline and stage.

use core::net::IpAddr;

use embassy_time::Instant;

use crate::settings::{AddressRange, PortId, Priority, Sharing};

/// The properties of a frame besides its PDU.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Envelope {
    /// The requester, to which the frame returns.
    pub origin: Origin,
    /// The MBAP transaction id of the response; 0 from serial lines, which have one request open at a time.
    pub transaction: u16,
    /// The requester's address, on TCP.
    pub peer: Option<IpAddr>,
    /// The unit id on the requester's side.
    pub unit: u8,
    /// The unit id on the destination's side, set by the router.
    pub target: u8,
    /// The port that the router sent it to.
    pub destination: Option<PortId>,
    /// Priority in the destination's queue, set by the router.
    pub priority: Priority,
    /// Whether it may share transactions and cached responses, set by the router.
    pub sharing: Sharing,
    /// The addresses that its rule allows, set by the router: a combined read covers nothing else.
    pub addresses: AddressRange,
    /// When the request was complete.
    pub received: Instant,
    /// The request must not be sent after this.
    pub deadline: Instant,
    /// Number of repeats so far.
    pub repeats: u8,
    /// Whether the PDU is the request or its response.
    pub stage: Stage,
    /// Whether the response may be cut through.
    pub cut: bool,
    /// The requester repeats and backs off by itself, so ports do not.
    pub paced: bool,
    /// The cause of an exception from the gateway.
    pub cause: Cause,
}

/// The cause of an exception from the gateway, where the code is ambiguous.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// 0B: no response in time.
    Silence,
    /// 0B: the response was corrupt.
    Corruption,
    /// 0B: the connection broke.
    Connection,
    /// 03: the response would be longer than a PDU may be.
    Length,
    /// Not sent: forbidden by a rule, refused by a full queue, or expired.
    Unsent,
}

/// The requester.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Origin {
    /// The port that received the request.
    pub port: PortId,
    /// The receiver of the response at the port.
    pub reply_to: ReplyTo,
    /// Number of the connection in its slot, or of the request on its line: a response to an earlier one must not reach its
    /// successor.
    pub generation: u16,
}

/// The receiver of the response.
// Starts at 1, so that an empty envelope is 0 and a free slot all zeros, which take no flash on a board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u16)]
pub enum ReplyTo {
    /// The TCP connection with this index.
    Connection(u16) = 1,
    /// The master on the port's serial line.
    Line,
    /// The port itself, which finds its request by `transaction`.
    Port,
    /// The console, whose requests bypass the rules.
    Console,
    /// Nobody: a broadcast from a serial line.
    Nobody,
}

/// The stages of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// The PDU is the request.
    Request,
    /// The PDU is the response, passed to the requester before it was complete.
    Responding,
    /// The PDU is the response.
    Response,
    /// There will be no response: a broadcast, or a discarded request.
    Silence,
}

impl Envelope {
    /// An unrouted request for `unit`. Requests from a network add `peer` and `transaction`.
    pub const fn request(origin: Origin, unit: u8, received: Instant, deadline: Instant) -> Self {
        Self { origin, unit, target: unit, received, deadline, ..Self::EMPTY }
    }

    pub(super) const EMPTY: Self = Self {
        origin: Origin { port: PortId(0), reply_to: ReplyTo::Nobody, generation: 0 },
        transaction: 0,
        peer: None,
        unit: 0,
        target: 0,
        destination: None,
        priority: Priority::Normal,
        sharing: Sharing::DEFAULT,
        addresses: AddressRange::ALL,
        received: Instant::MIN,
        deadline: Instant::MAX,
        repeats: 0,
        stage: Stage::Request,
        cut: false,
        paced: false,
        cause: Cause::Silence,
    };
}
