//! What the gateway knows of a frame besides its PDU: who asked, for which unit, until when, and how far it is.

use core::net::IpAddr;

use embassy_time::Instant;

use crate::settings::{AddressRange, PortId, Priority, Sharing};

/// What the gateway knows of a frame besides its PDU.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Envelope {
    /// Who asked; the frame goes back there.
    pub origin: Origin,
    /// The MBAP transaction id to give back; 0 from serial lines, which have one request open at a time.
    pub transaction: u16,
    /// The requester's address, on TCP.
    pub peer: Option<IpAddr>,
    /// The unit id as the requester wrote it.
    pub unit: u8,
    /// The unit id on the destination's side, set by the router.
    pub target: u8,
    /// The port that the router sent it to.
    pub destination: Option<PortId>,
    /// Rank in the destination's queue, set by the router.
    pub priority: Priority,
    /// Whose answers will do for it, set by the router.
    pub sharing: Sharing,
    /// The addresses that its rule allows, set by the router: nothing else is read along with it.
    pub addresses: AddressRange,
    /// When the request was complete.
    pub received: Instant,
    /// From here on the request is not sent any more.
    pub deadline: Instant,
    /// How often it was sent again.
    pub repeats: u8,
    /// Whether the PDU is the request or its response.
    pub stage: Stage,
    /// Whether the response may be passed on while it arrives.
    pub cut: bool,
    /// The requester repeats its requests and spares units that are down by itself: no port does that for it.
    pub paced: bool,
    /// What is behind an exception of the gateway.
    pub cause: Cause,
}

/// What is behind an exception of the gateway, where its code does not tell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// Behind 0B: no response came in time.
    Silence,
    /// Behind 0B: the response was damaged on its way.
    Corruption,
    /// Behind 0B: the connection broke.
    Connection,
    /// Behind 03: the response would be longer than a PDU may be.
    Length,
    /// Nobody has been asked: a rule forbids it, too many requests wait, or the request's time was over.
    Unsent,
}

/// Who asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Origin {
    /// The port that received the request.
    pub port: PortId,
    /// Where at that port the response goes.
    pub reply_to: ReplyTo,
    /// Which connection in a row it is at that connection, or which request in a row on that line: a response for an earlier one
    /// must not reach its successor.
    pub generation: u16,
}

/// The way back to whoever asked.
// From 1 on: then no envelope at all is the 0, and a free slot is all zeros, which take no place in a board's flash.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u16)]
pub enum ReplyTo {
    /// To the TCP connection at this place.
    Connection(u16) = 1,
    /// To the port itself: the master on its serial line.
    Line,
    /// To the port itself, which tells what it has open by `transaction`.
    Port,
    /// To the console that asks past the rules.
    Console,
    /// None: a broadcast on a serial line, for whose answer nobody waits.
    Nobody,
}

/// Where in its life a frame is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// The PDU is the request.
    Request,
    /// The PDU is the response, and whoever asked has been given the frame before it was whole.
    Responding,
    /// The PDU is the response.
    Response,
    /// There is no response, and none is to be given: a broadcast, a discarded request.
    Silence,
}

impl Envelope {
    /// A request for `unit` that is not yet routed. From a network, `peer` and `transaction` are to be added.
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
