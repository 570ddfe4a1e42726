//! Ethernet over EtherCAT: frames to and from the application's network, in fragments (ETG.1000.6, clause 5.7).
//!
//! A fragment in the mailbox goes to the reassembly, and a complete frame to the [`Link`]; frames of the link leave in fragments, one
//! for each time that the mailbox is free. Like any Ethernet it loses frames: whatever does not fit drops the frame that it belongs
//! to. A MainDevice sets and reads IP settings as well.
//!
//! The buffers of both directions are in [`Eoe`], a value of the application, so that a device without Ethernet has none.

mod error;
mod fragments;
mod header;
mod link;
mod reassembly;
mod settings;

use embassy_time::Instant;

use crate::mailbox::{MailboxError, Payload};
use fragments::Outgoing;
use header::Header;
use reassembly::Reassembly;

pub use error::EthernetError;
pub use link::{FRAME_BYTES_MAX, FRAME_BYTES_MIN, Link};
pub use reassembly::REASSEMBLY_WAIT;
pub use settings::{IpSettings, NAME_BYTES_MAX};

/// Shortest mailbox that carries frames: both headers, and the smallest fragment.
pub const MAILBOX_BYTES_MIN: u16 = 42;

/// The kinds of messages (ETG.1000.6, table 94). A response's number is that of its request and 1; that to a fragment tells a time.
const FRAGMENT: u8 = 0;
const SET_IP: u8 = 2;
const SET_FILTER: u8 = 4;
const GET_IP: u8 = 6;
const GET_FILTER: u8 = 8;

/// What serves messages of Ethernet: [`Eoe`], or whatever passes the calls on to one.
pub trait Ethernet {
    /// Takes a message, with `room` bytes of a mailbox for a response.
    ///
    /// # Errors
    /// If the message is too short, or of a kind that is unknown.
    fn request(&mut self, payload: &[u8], room: usize, now: Instant)
    -> Result<Option<Payload>, MailboxError>;

    /// The next fragment for the MainDevice; `room` as in [`request`](Self::request).
    fn next(&mut self, room: usize) -> Option<Payload>;

    /// Whether there is one.
    fn is_sending(&mut self) -> bool;

    /// Drops the frames that are not complete: the mailboxes start anew.
    fn start(&mut self);
}

/// Ethernet between the mailboxes and a [`Link`].
#[derive(Debug)]
pub struct Eoe<L> {
    /// The application's network.
    pub link: L,
    incoming: Reassembly,
    outgoing: Outgoing,
    /// The port in the MainDevice's last message, for frames to it: SOEM takes those of its own port only.
    port: u8,
}

impl<L: Link> Eoe<L> {
    /// Ethernet for `link`.
    pub const fn new(link: L) -> Self {
        Self { link, incoming: Reassembly::new(), outgoing: Outgoing::new(), port: 0 }
    }

    fn get_ip(&mut self, port: u8, room: usize) -> Payload {
        let body = self.link.settings().and_then(|settings| {
            settings.encode(room.saturating_sub(header::HEADER_BYTES)).ok_or(EthernetError::Unspecified)
        });
        match body {
            Ok(body) => Header::response(GET_IP, port, 0).message(&body),
            Err(error) => Header::response(GET_IP, port, error as u16).message(&[]),
        }
    }

    fn set_ip(&mut self, body: &[u8], port: u8) -> Result<Payload, MailboxError> {
        let set = IpSettings::decode(body)?.and_then(|settings| match settings.are_valid() {
            true => self.link.configure(&settings),
            false => Err(EthernetError::Unspecified),
        });
        let result = set.err().map_or(0, |error| error as u16);
        Ok(Header::response(SET_IP, port, result).message(&[]))
    }
}

impl<L: Link + Default> Default for Eoe<L> {
    fn default() -> Self {
        Self::new(L::default())
    }
}

impl<L: Link> Ethernet for Eoe<L> {
    fn request(
        &mut self,
        payload: &[u8],
        room: usize,
        now: Instant,
    ) -> Result<Option<Payload>, MailboxError> {
        let (header, body) = Header::decode(payload)?;
        let port = header.port();
        let response = match header.kind() {
            FRAGMENT => {
                self.port = port;
                if let Some(frame) = self.incoming.take(header, body, now) {
                    self.link.receive(frame);
                }
                // When the network passes it on is not known.
                if !(header.is_last() && header.asks_time()) {
                    return Ok(None);
                }
                Header::response(FRAGMENT, port, EthernetError::UnsupportedFrameType as u16).message(&[])
            }
            SET_IP => self.set_ip(body, port)?,
            GET_IP => self.get_ip(port, room),
            kind @ (SET_FILTER | GET_FILTER) => {
                Header::response(kind, port, EthernetError::NoFilterSupport as u16).message(&[])
            }
            _ => return Err(MailboxError::ServiceNotSupported),
        };
        Ok(Some(response))
    }

    fn next(&mut self, room: usize) -> Option<Payload> {
        // A frame that no mailbox carries makes room for the next one.
        self.outgoing.load(&mut self.link).then(|| self.outgoing.next(room, self.port)).flatten()
    }

    fn is_sending(&mut self) -> bool {
        self.outgoing.load(&mut self.link)
    }

    fn start(&mut self) {
        self.incoming.drop_partial();
        self.outgoing.drop_partial();
        self.link.start();
    }
}

/// The Ethernet of an application that has none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NoEthernet;

impl Ethernet for NoEthernet {
    fn request(
        &mut self,
        _payload: &[u8],
        _room: usize,
        _now: Instant,
    ) -> Result<Option<Payload>, MailboxError> {
        Err(MailboxError::UnsupportedProtocol)
    }

    fn next(&mut self, _room: usize) -> Option<Payload> {
        None
    }

    fn is_sending(&mut self) -> bool {
        false
    }

    fn start(&mut self) {}
}

#[cfg(test)]
mod tests;
