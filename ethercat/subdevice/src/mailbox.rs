//! Mailbox: messages with counters, their order, and their repetition after a lost frame (ETG.1000.4, clause 5.6; ETG.1000.6).
//!
//! A full queue loses nothing: a request stays in SM0, which blocks the MainDevice, until there is room for its response. A
//! response is kept until SM1 was read, and one message longer, since the MainDevice may request a repetition.

use heapless::{Deque, Vec};

/// Most bytes of a mailbox.
pub const MAILBOX_BYTES_MAX: usize = 128;
/// Bytes of the header of each message.
pub const HEADER_BYTES: usize = 6;
/// Most bytes of a message after its header.
pub const PAYLOAD_BYTES_MAX: usize = MAILBOX_BYTES_MAX - HEADER_BYTES;
/// Messages waiting for SM1. One slot stays free for a message displaced by a repetition.
const OUTBOX_MESSAGES: usize = 3;

/// The content of a message after its header.
pub type Payload = Vec<u8, PAYLOAD_BYTES_MAX>;

/// The protocol of a message; the number is the header's type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Protocol {
    /// Reports an error in a message.
    Error = 0,
    /// Ethernet over EtherCAT.
    Ethernet = 2,
    /// CAN application protocol over EtherCAT.
    CanOpen = 3,
    /// File access over EtherCAT.
    File = 4,
}

/// The error in a message, as coded in an error reply.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum MailboxError {
    /// Protocol not supported.
    UnsupportedProtocol = 2,
    /// Service of the protocol not supported.
    ServiceNotSupported = 4,
    /// Invalid header.
    InvalidHeader = 5,
    /// Too short for its service.
    SizeTooShort = 6,
    /// Longer than the mailbox.
    InvalidSize = 8,
}

/// A request to serve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Request<'a> {
    /// The header's type: the number of a [`Protocol`], if known.
    pub protocol: u8,
    /// The content after the header.
    pub payload: &'a [u8],
}

/// A message on its way to the MainDevice.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Message {
    protocol: Protocol,
    counter: u8,
    payload: Payload,
}

/// The state of both mailboxes.
#[derive(Debug, Default)]
pub struct Mailbox {
    /// Bytes of SM1.
    bytes: usize,
    /// The counter of the last request, 0 when there was none.
    received: u8,
    /// The counter of the last response.
    sent: u8,
    waiting: Deque<Message, OUTBOX_MESSAGES>,
    /// In SM1, and not read as far as is known.
    current: Option<Message>,
    /// Read, but possibly lost on its way.
    fetched: Option<Message>,
    /// Whether `current` repeats `fetched`.
    repeating: bool,
    /// The repeat bit acknowledged last.
    repeat: bool,
}

impl Mailbox {
    /// Resets the state for mailboxes of `bytes`, with the present repeat bit.
    pub fn start(&mut self, bytes: u16, repeat: bool) {
        *self = Self { bytes: usize::from(bytes).min(MAILBOX_BYTES_MAX), repeat, ..Self::default() };
    }

    /// Most bytes of a message in the mailbox, after its header.
    pub fn payload_bytes(&self) -> usize {
        self.bytes.saturating_sub(HEADER_BYTES)
    }

    /// Whether there is room for a response, so that a request may be taken from SM0.
    pub fn has_room(&self) -> bool {
        self.waiting.len() + 1 < OUTBOX_MESSAGES
    }

    /// Whether no message waits besides the one in SM1.
    pub fn is_idle(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Whether SM1 holds an unread message, as far as is known.
    pub fn is_occupied(&self) -> bool {
        self.current.is_some()
    }

    /// Parses the content of SM0. Returns `None` for a repetition, or if an error reply was queued.
    pub fn receive<'m>(&mut self, mailbox: &'m [u8]) -> Option<Request<'m>> {
        let (&[length_low, length_high, _, _, _, kind], body) = mailbox.split_first_chunk()?;
        let (protocol, counter) = (kind & 0x0f, (kind >> 4) & 0x07);
        // A MainDevice without acknowledgement writes the same message again; 0 disables counting.
        if counter != 0 && counter == self.received {
            return None;
        }
        self.received = counter;
        let length = usize::from(u16::from_le_bytes([length_low, length_high]));
        match body.get(..length) {
            Some(payload) if length != 0 && protocol != Protocol::Error as u8 => {
                Some(Request { protocol, payload })
            }
            Some(_) => self.refuse(MailboxError::InvalidHeader),
            None => self.refuse(MailboxError::InvalidSize),
        }
    }

    /// Queues an error reply. Returns `None` in place of a request.
    pub fn refuse<T>(&mut self, error: MailboxError) -> Option<T> {
        let [low, high] = (error as u16).to_le_bytes();
        // 0001h: error reply, the only command of its protocol.
        let payload = Payload::from_slice(&[0x01, 0x00, low, high]).unwrap_or_default();
        self.send(Protocol::Error, payload);
        None
    }

    /// Queues a message. The caller has checked for [room](Self::has_room).
    pub fn send(&mut self, protocol: Protocol, payload: Payload) {
        self.sent = self.sent % 7 + 1;
        let kept = self.waiting.push_back(Message { protocol, counter: self.sent, payload });
        debug_assert!(kept.is_ok(), "a request is taken only when there is room for its response");
    }

    /// SM1 was read.
    pub fn fetched(&mut self) {
        if let Some(message) = self.current.take() {
            self.fetched = Some(message);
            self.repeating = false;
        }
    }

    /// Writes the next message for the empty SM1 into `into`; returns all of the mailbox's bytes.
    pub fn next<'b>(&mut self, into: &'b mut [u8; MAILBOX_BYTES_MAX]) -> Option<&'b [u8]> {
        if self.current.is_some() {
            return None;
        }
        self.current = Some(self.waiting.pop_front()?);
        self.write_current(into)
    }

    /// Whether the repeat bit requests a new repetition.
    pub fn is_repeat(&self, repeat: bool) -> bool {
        repeat != self.repeat
    }

    /// The repeat bit acknowledged last.
    pub fn acknowledged(&self) -> bool {
        self.repeat
    }

    /// Returns the last message read, to repeat it; an unread one follows. The caller has emptied SM1. `None` if nothing was ever
    /// sent.
    pub fn repeat<'b>(&mut self, repeat: bool, into: &'b mut [u8; MAILBOX_BYTES_MAX]) -> Option<&'b [u8]> {
        self.repeat = repeat;
        if let (Some(fetched), false) = (&self.fetched, self.repeating) {
            let again = fetched.clone();
            if let Some(unread) = self.current.replace(again) {
                let kept = self.waiting.push_front(unread);
                debug_assert!(kept.is_ok(), "one place stays free");
            }
            self.repeating = true;
        }
        self.write_current(into)
    }

    fn write_current<'b>(&self, into: &'b mut [u8; MAILBOX_BYTES_MAX]) -> Option<&'b [u8]> {
        let Message { protocol, counter, payload } = self.current.as_ref()?;
        let [low, high] = (payload.len() as u16).to_le_bytes();
        into.fill(0);
        let (header, body) = into.split_first_chunk_mut::<HEADER_BYTES>()?;
        // Address 0: the MainDevice; channel and priority 0.
        *header = [low, high, 0, 0, 0, *protocol as u8 | counter << 4];
        body.get_mut(..payload.len())?.copy_from_slice(payload);
        into.get(..self.bytes)
    }
}

#[cfg(test)]
mod tests;
