//! Mailbox: messages with counters, their order, and their repetition when a frame was lost (ETG.1000.4, clause 5.6; ETG.1000.6).
//!
//! Nothing is lost for want of room: a request stays in SM0, which holds the MainDevice off, until its answer has a place.
//! An answer stays here until SM1 was fetched, and one message longer, since the MainDevice may ask for it again.

use heapless::{Deque, Vec};

/// Bytes of a mailbox at most.
pub const MAILBOX_BYTES_MAX: usize = 128;
/// Bytes of the header in front of each message.
pub const HEADER_BYTES: usize = 6;
/// Bytes of a message behind its header, at most.
pub const PAYLOAD_BYTES_MAX: usize = MAILBOX_BYTES_MAX - HEADER_BYTES;
/// Messages that wait for SM1. One place stays free for a message that a repetition pushes back.
const OUTBOX_MESSAGES: usize = 3;

/// What a message carries behind the header.
pub type Payload = Vec<u8, PAYLOAD_BYTES_MAX>;

/// The protocol of a message; the number is the header's type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Protocol {
    /// Says what is wrong with a message.
    Error = 0,
    /// Ethernet over EtherCAT.
    Ethernet = 2,
    /// CAN application protocol over EtherCAT.
    CanOpen = 3,
    /// File access over EtherCAT.
    File = 4,
}

/// What is wrong with a message, as an error reply says it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum MailboxError {
    /// A protocol that is not served.
    UnsupportedProtocol = 2,
    /// A service of the protocol that is not served.
    ServiceNotSupported = 4,
    /// The header makes no sense.
    InvalidHeader = 5,
    /// Shorter than its service needs.
    SizeTooShort = 6,
    /// Longer than the mailbox.
    InvalidSize = 8,
}

/// A request that is to be served.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Request<'a> {
    /// The header's type: a [`Protocol`] if it is one that is known.
    pub protocol: u8,
    /// What is behind the header.
    pub payload: &'a [u8],
}

/// A message on its way to the MainDevice.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Message {
    protocol: Protocol,
    counter: u8,
    payload: Payload,
}

/// Both mailboxes' state.
#[derive(Debug, Default)]
pub struct Mailbox {
    /// Bytes of SM1.
    bytes: usize,
    /// The counter of the last request, 0 when there was none.
    received: u8,
    /// The counter of the last answer.
    sent: u8,
    waiting: Deque<Message, OUTBOX_MESSAGES>,
    /// In SM1, and not fetched as far as is known.
    current: Option<Message>,
    /// Fetched, but perhaps lost on its way.
    fetched: Option<Message>,
    /// Whether `current` is `fetched` once more.
    repeating: bool,
    /// The repeat bit that was answered last.
    repeat: bool,
}

impl Mailbox {
    /// Starts afresh with mailboxes of `bytes`, from where the repeat bit is now.
    pub fn start(&mut self, bytes: u16, repeat: bool) {
        *self = Self { bytes: usize::from(bytes).min(MAILBOX_BYTES_MAX), repeat, ..Self::default() };
    }

    /// Bytes of a message behind the header that fit into the mailbox.
    pub fn payload_bytes(&self) -> usize {
        self.bytes.saturating_sub(HEADER_BYTES)
    }

    /// Whether an answer could be kept, so that a request may be taken from SM0.
    pub fn has_room(&self) -> bool {
        self.waiting.len() + 1 < OUTBOX_MESSAGES
    }

    /// Whether nothing waits behind what is in SM1.
    pub fn is_idle(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Whether SM1 holds a message that was not fetched, as far as is known.
    pub fn is_occupied(&self) -> bool {
        self.current.is_some()
    }

    /// Looks at what is in SM0. Nothing comes back when it was had before, or was answered by an error already.
    pub fn receive<'m>(&mut self, mailbox: &'m [u8]) -> Option<Request<'m>> {
        let (&[length_low, length_high, _, _, _, kind], body) = mailbox.split_first_chunk()?;
        let (protocol, counter) = (kind & 0x0f, (kind >> 4) & 0x07);
        // A MainDevice that saw no acknowledgement writes the same message again; 0 means that it does not count.
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

    /// Answers that a message was not understood. Gives nothing, for the place where a request would stand.
    pub fn refuse<T>(&mut self, error: MailboxError) -> Option<T> {
        let [low, high] = (error as u16).to_le_bytes();
        // 0001h: this is an error reply, the only command of its protocol.
        let payload = Payload::from_slice(&[0x01, 0x00, low, high]).unwrap_or_default();
        self.send(Protocol::Error, payload);
        None
    }

    /// Queues a message. The caller has looked for [room](Self::has_room), so it does not get lost.
    pub fn send(&mut self, protocol: Protocol, payload: Payload) {
        self.sent = self.sent % 7 + 1;
        let kept = self.waiting.push_back(Message { protocol, counter: self.sent, payload });
        debug_assert!(kept.is_ok(), "a request is taken only when there is room for its answer");
    }

    /// SM1 was fetched.
    pub fn fetched(&mut self) {
        if let Some(message) = self.current.take() {
            self.fetched = Some(message);
            self.repeating = false;
        }
    }

    /// Takes the next message for SM1, which is empty: written into `into`, all of the mailbox's bytes.
    pub fn next<'b>(&mut self, into: &'b mut [u8; MAILBOX_BYTES_MAX]) -> Option<&'b [u8]> {
        if self.current.is_some() {
            return None;
        }
        self.current = Some(self.waiting.pop_front()?);
        self.write_current(into)
    }

    /// Whether the repeat bit asks for something new.
    pub fn is_repeat(&self, repeat: bool) -> bool {
        repeat != self.repeat
    }

    /// The repeat bit that was answered last.
    pub fn acknowledged(&self) -> bool {
        self.repeat
    }

    /// Puts the last message that was fetched first again; what has not been fetched comes behind it. SM1 was emptied for that.
    /// Nothing is written when nothing was ever sent.
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
        // Address 0: the MainDevice itself; channel and priority 0.
        *header = [low, high, 0, 0, 0, *protocol as u8 | counter << 4];
        body.get_mut(..payload.len())?.copy_from_slice(payload);
        into.get(..self.bytes)
    }
}

#[cfg(test)]
mod tests;
