//! Mailbox: messages with counters, their order, and their repetition when a frame was lost (ETG.1000.4, clause 5.6; ETG.1000.6).
//!
//! Nothing is lost for want of room: a request stays in SM0, which holds the MainDevice off, until its answer has a place.
//! An answer stays here until SM1 was fetched, and one message longer, since the MainDevice may ask for it again.

use heapless::{Deque, Vec};

/// Bytes of a mailbox at most.
pub const MAILBOX_BYTES_MAX: usize = 256;
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
mod tests {
    use heapless::Vec;

    use super::{MAILBOX_BYTES_MAX, Mailbox, Payload, Protocol};

    const SIZE: usize = 64;

    fn started() -> Mailbox {
        let mut mailbox = Mailbox::default();
        mailbox.start(SIZE as u16, false);
        mailbox
    }

    fn request(kind: u8, length: u16) -> [u8; SIZE] {
        let mut bytes = [0; SIZE];
        bytes[..2].copy_from_slice(&length.to_le_bytes());
        bytes[5] = kind;
        bytes
    }

    /// The next message as far as its length says.
    fn next(mailbox: &mut Mailbox) -> Option<Vec<u8, SIZE>> {
        let mut buffer = [0; MAILBOX_BYTES_MAX];
        let message = mailbox.next(&mut buffer)?;
        Vec::from_slice(&message[..message[0] as usize + 6]).ok()
    }

    fn send(mailbox: &mut Mailbox, mark: u8) {
        mailbox.send(Protocol::CanOpen, Payload::from_slice(&[mark]).unwrap());
    }

    #[test]
    fn a_request_with_the_counter_of_the_last_one_is_dropped() {
        let mut mailbox = started();
        assert!(mailbox.receive(&request(0x13, 10)).is_some());
        assert!(mailbox.receive(&request(0x13, 10)).is_none());
        assert!(mailbox.receive(&request(0x23, 10)).is_some());
        assert_eq!(next(&mut mailbox), None, "a duplicate is dropped without a word");
    }

    #[test]
    fn counter_0_is_always_taken() {
        let mut mailbox = started();
        assert!((0..3).all(|_| mailbox.receive(&request(0x03, 10)).is_some()));
    }

    #[test]
    fn answers_count_from_1_to_7_and_again() {
        let mut mailbox = started();
        for counter in [1, 2, 3, 4, 5, 6, 7, 1, 2] {
            send(&mut mailbox, 0);
            assert_eq!(next(&mut mailbox).unwrap()[5] >> 4, counter);
            mailbox.fetched();
        }
    }

    #[test]
    fn malformed_headers_are_answered_by_their_error() {
        for (bytes, detail) in [
            (request(0x13, 0), 5),
            (request(0x10, 4), 5),
            (request(0x13, SIZE as u16 - 5), 8),
            (request(0x13, 0xffff), 8),
        ] {
            let mut mailbox = started();
            assert_eq!(mailbox.receive(&bytes), None);
            assert_eq!(next(&mut mailbox).unwrap(), [4, 0, 0, 0, 0, 0x10, 1, 0, detail, 0]);
        }
    }

    #[test]
    fn the_largest_message_fits_exactly() {
        assert!(started().receive(&request(0x13, SIZE as u16 - 6)).is_some());
    }

    #[test]
    fn a_message_takes_the_whole_mailbox_and_nothing_of_the_one_before_is_left_behind_it() {
        let mut mailbox = started();
        let mut buffer = [0xff; MAILBOX_BYTES_MAX];
        send(&mut mailbox, 7);
        let message = mailbox.next(&mut buffer).unwrap();
        assert_eq!(message.len(), SIZE);
        assert_eq!(message[..7], [1, 0, 0, 0, 0, 0x13, 7]);
        assert!(message[7..].iter().all(|&byte| byte == 0), "{message:02x?}");
    }

    #[test]
    fn answers_keep_their_order_and_wait_for_the_mailbox() {
        let mut mailbox = started();
        send(&mut mailbox, 1);
        send(&mut mailbox, 2);
        assert!(!mailbox.has_room());
        assert_eq!(next(&mut mailbox).unwrap()[6], 1);
        assert_eq!(next(&mut mailbox), None);
        mailbox.fetched();
        assert_eq!(next(&mut mailbox).unwrap()[6], 2);
    }

    #[test]
    fn a_repetition_brings_the_fetched_message_and_then_the_unread_one() {
        let mut mailbox = started();
        let mut buffer = [0; MAILBOX_BYTES_MAX];
        assert_eq!(mailbox.repeat(true, &mut buffer), None, "nothing was sent yet");
        send(&mut mailbox, 1);
        let first = next(&mut mailbox).unwrap();
        mailbox.fetched();
        send(&mut mailbox, 2);
        let second = next(&mut mailbox).unwrap();

        assert!(mailbox.is_repeat(false));
        for toggle in [false, true] {
            assert_eq!(
                mailbox.repeat(toggle, &mut buffer).unwrap()[..7],
                first[..],
                "however often it is asked for"
            );
        }
        assert!(!mailbox.is_repeat(true));
        mailbox.fetched();
        assert_eq!(next(&mut mailbox).unwrap(), second);
    }

    #[test]
    fn a_header_has_protocol_and_counter_in_its_last_byte_and_its_length_in_the_first_two() {
        for kind in 0..=255_u8 {
            let mut mailbox = started();
            let bytes = request(kind, 3);
            let expected = (kind & 15 != 0).then_some((kind & 15, &[0; 3][..]));
            let got = mailbox.receive(&bytes).map(|request| (request.protocol, request.payload));
            assert_eq!(got, expected, "{kind:02x}");
            // The bit above the counter is none of it.
            let again = mailbox.receive(&request(kind ^ 0x80, 3)).is_some();
            assert_eq!(again, expected.is_some() && kind & 0x70 == 0, "{kind:02x}");
        }
        let mut long = [0; 300];
        (long[1], long[5]) = (1, 0x13);
        assert_eq!(started().receive(&long).map(|request| request.payload.len()), Some(256));
        assert_eq!(started().receive(&long[..5]), None);
    }

    #[test]
    fn a_mailbox_is_as_long_as_it_was_started_and_no_longer_than_there_is_memory() {
        for (bytes, payload) in [(0, 0), (6, 0), (7, 1), (64, 58), (256, 250), (257, 250), (1024, 250)] {
            let mut mailbox = Mailbox::default();
            mailbox.start(bytes, false);
            assert_eq!(mailbox.payload_bytes(), payload, "{bytes}");
        }
        let mut mailbox = started();
        send(&mut mailbox, 1);
        assert!(mailbox.receive(&request(0x13, 1)).is_some());
        mailbox.start(64, true);
        assert!(mailbox.is_idle() && !mailbox.is_occupied() && mailbox.has_room());
        assert!(mailbox.is_repeat(false) && !mailbox.is_repeat(true));
        assert!(mailbox.receive(&request(0x13, 1)).is_some(), "it counts anew");
        send(&mut mailbox, 2);
        assert_eq!(next(&mut mailbox).unwrap(), [1, 0, 0, 0, 0, 0x13, 2]);
    }

    #[test]
    fn what_waits_and_what_is_in_the_mailbox_are_told_apart() {
        let mut mailbox = started();
        let state = |mailbox: &Mailbox| (mailbox.is_idle(), mailbox.is_occupied(), mailbox.has_room());
        assert_eq!(state(&mailbox), (true, false, true));
        send(&mut mailbox, 1);
        assert_eq!(state(&mailbox), (false, false, true));
        assert!(next(&mut mailbox).is_some());
        assert_eq!(state(&mailbox), (true, true, true));
        send(&mut mailbox, 2);
        send(&mut mailbox, 3);
        assert_eq!(state(&mailbox), (false, true, false));
        mailbox.fetched();
        assert_eq!(state(&mailbox), (false, false, false));
        assert!(next(&mut mailbox).is_some());
        mailbox.fetched();
        assert!(next(&mut mailbox).is_some());
        assert_eq!(state(&mailbox), (true, true, true));
        mailbox.fetched();
        mailbox.fetched();
        assert_eq!((state(&mailbox), next(&mut mailbox)), ((true, false, true), None));
    }

    #[test]
    fn after_a_repetition_was_fetched_the_message_can_be_had_once_more() {
        let mut mailbox = started();
        let mut buffer = [0; MAILBOX_BYTES_MAX];
        send(&mut mailbox, 1);
        let first = next(&mut mailbox).unwrap();
        mailbox.fetched();
        for toggle in [true, false, true] {
            assert_eq!(mailbox.repeat(toggle, &mut buffer).unwrap()[..7], first[..]);
            mailbox.fetched();
            assert_eq!(next(&mut mailbox), None);
        }
        // The last one that was fetched is repeated, not an older one.
        send(&mut mailbox, 2);
        let second = next(&mut mailbox).unwrap();
        assert_eq!(mailbox.repeat(false, &mut buffer).unwrap()[..7], first[..]);
        mailbox.fetched();
        assert_eq!(next(&mut mailbox).unwrap(), second);
        mailbox.fetched();
        assert_eq!(mailbox.repeat(true, &mut buffer).unwrap()[..7], second[..]);
    }
}
