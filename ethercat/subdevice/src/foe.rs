//! File access over EtherCAT: a MainDevice reads and writes files of the application (ETG.1000.6, clause 5.8).
//!
//! Both sides take turns: `write request, ack 0, data 1, ack 1, ...` and `read request, data 1, ack 1, data 2, ...`; data shorter
//! than a mailbox end a file, if need be empty ones. [`Foe::request`] takes the MainDevice's message, and [`Foe::next`] makes the
//! SubDevice's, as soon as the application has done its part.

mod files;

use embassy_time::{Duration, Instant};

use crate::al_state::AlState;
use crate::mailbox::{MailboxError, PAYLOAD_BYTES_MAX, Payload};

pub use files::{FileError, FileErrorCode, Files, NoFiles, Opening, TEXT_BYTES_MAX, Transfer};

/// Bytes before a file's name, its bytes, or the text of an error: operation, reserved, and a number.
const HEADER_BYTES: usize = 6;
/// Most bytes of a file in a message.
const PACKET_BYTES_MAX: usize = PAYLOAD_BYTES_MAX - HEADER_BYTES;
/// How long the application may take to store a packet before the MainDevice is told that it is busy. pysoem waits for 200 ms.
pub const BUSY_AFTER: Duration = Duration::from_millis(100);
/// How long the MainDevice may take for its next message.
pub const ABANDONED_AFTER: Duration = Duration::from_secs(10);

/// The number of a busy message: how many parts are done (low word), of how many (high word). How long flash memory takes is not known.
const NOTHING_OF_ONE: u32 = 1 << 16;

/// The text for a request while another transfer is open.
const SECOND: &str = "another transfer was open, and has ended now: ask again";

/// In which states a MainDevice reads and writes files; the application has a say in each file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileAccess {
    /// In none: the device has no FoE.
    None,
    /// In PreOp, SafeOp and Op.
    WithoutBoot,
    /// In Boot as well, which is for new firmware.
    WithBoot,
}

/// The kind of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
enum Operation {
    ReadRequest = 1,
    WriteRequest = 2,
    Data = 3,
    Ack = 4,
    Error = 5,
    Busy = 6,
}

impl Operation {
    const fn from_byte(byte: u8) -> Option<Self> {
        match byte {
            1 => Some(Self::ReadRequest),
            2 => Some(Self::WriteRequest),
            3 => Some(Self::Data),
            4 => Some(Self::Ack),
            5 => Some(Self::Error),
            6 => Some(Self::Busy),
            _ => None,
        }
    }

    /// A message of `room` bytes at most, which may cut `rest` off.
    fn message(self, number: u32, rest: &[u8], room: usize) -> Payload {
        let mut payload = Payload::new();
        let rest = rest.get(..room.saturating_sub(HEADER_BYTES)).unwrap_or(rest);
        let header = [self as u8, 0].into_iter().chain(number.to_le_bytes());
        payload.extend(header.chain(rest.iter().copied()).take(PAYLOAD_BYTES_MAX));
        payload
    }
}

/// Whose turn it is, and for what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Turn {
    /// No file is open.
    Idle,
    /// The application opens a file.
    Opening(Transfer),
    /// The MainDevice sends the next packet.
    Receiving,
    /// The application does something about a packet.
    Storing(Step),
    /// The same, and the MainDevice was told; it sends its packet again to hear of the result.
    Busy(Step),
    /// The application reads a packet.
    Reading,
    /// The MainDevice acknowledges a packet.
    Sent { last: bool },
}

/// What the application does about a packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    /// Stores it.
    Store,
    /// Stores the last one.
    StoreLast,
    /// Finishes the file whose last packet it has stored.
    Finish,
    /// Finishes a file, for an empty packet.
    FinishEmpty,
}

/// A transfer of a file.
#[derive(Debug)]
pub struct Foe {
    turn: Turn,
    /// Since when it is that turn.
    since: Instant,
    /// The number of the last packet.
    packet: u32,
    /// The last packet sent, which the MainDevice may want again.
    data: Payload,
}

impl Default for Foe {
    fn default() -> Self {
        Self { turn: Turn::Idle, since: Instant::MIN, packet: 0, data: Payload::new() }
    }
}

impl Foe {
    /// Takes a message in `state`, with `room` bytes of a mailbox for a response. Other responses come from [`next`](Self::next).
    ///
    /// # Errors
    /// If the message has no complete header.
    pub fn request(
        &mut self,
        payload: &[u8],
        files: &mut impl Files,
        state: AlState,
        room: usize,
        now: Instant,
    ) -> Result<Option<Payload>, MailboxError> {
        let (&[operation, _reserved, number @ ..], rest) =
            payload.split_first_chunk::<HEADER_BYTES>().ok_or(MailboxError::SizeTooShort)?;
        let number = u32::from_le_bytes(number);
        let taken = match Operation::from_byte(operation) {
            Some(Operation::ReadRequest) => self.open(Transfer::Read, number, rest, files, state),
            Some(Operation::WriteRequest) => self.open(Transfer::Write, number, rest, files, state),
            Some(Operation::Data) => {
                self.take(number, rest, files, room - HEADER_BYTES).map_err(FileError::from)
            }
            Some(Operation::Ack) => self.acknowledged(number, files).map_err(FileError::from),
            // Here it is the MainDevice that wants its packet later.
            Some(Operation::Busy) if matches!(self.turn, Turn::Sent { .. }) => {
                self.since = now;
                return Ok(Some(self.data.clone()));
            }
            Some(Operation::Error) => {
                self.end(files);
                Ok(())
            }
            Some(Operation::Busy) | None => Err(FileErrorCode::Illegal.into()),
        };
        self.since = now;
        Ok(taken.err().map(|error| {
            self.end(files);
            refusal(&error, room)
        }))
    }

    fn open(
        &mut self,
        transfer: Transfer,
        password: u32,
        name: &[u8],
        files: &mut impl Files,
        state: AlState,
    ) -> Result<(), FileError> {
        // It ends as well, as behind any other message that does not fit, so that the next request is served.
        if !matches!(self.turn, Turn::Idle | Turn::Sent { last: true }) {
            return Err(FileError::new(FileErrorCode::Illegal, SECOND));
        }
        self.end(files);
        // Some MainDevices end it with a zero.
        let name = name.split(|&byte| byte == 0).next().unwrap_or_default();
        let name = str::from_utf8(name).map_err(|_| FileErrorCode::NotFound)?;
        files.open(&Opening { transfer, name, password, state });
        (self.turn, self.packet) = (Turn::Opening(transfer), 0);
        Ok(())
    }

    fn take(
        &mut self,
        number: u32,
        bytes: &[u8],
        files: &mut impl Files,
        most: usize,
    ) -> Result<(), FileErrorCode> {
        match self.turn {
            Turn::Receiving if number == self.packet.wrapping_add(1) => {
                self.packet = number;
                let step = match bytes.len() {
                    0 => Step::FinishEmpty,
                    length if length < most => Step::StoreLast,
                    _ => Step::Store,
                };
                match bytes {
                    [] => files.finish(),
                    bytes => files.write(bytes),
                }
                self.turn = Turn::Storing(step);
                Ok(())
            }
            // Not another one, which would be written: the same, as its sender waits for the response.
            Turn::Storing(step) | Turn::Busy(step) if number == self.packet => {
                self.turn = Turn::Storing(step);
                Ok(())
            }
            Turn::Receiving | Turn::Storing(_) | Turn::Busy(_) => Err(FileErrorCode::PacketNumber),
            _ => Err(FileErrorCode::Illegal),
        }
    }

    fn acknowledged(&mut self, number: u32, files: &mut impl Files) -> Result<(), FileErrorCode> {
        let Turn::Sent { last } = self.turn else { return Err(FileErrorCode::Illegal) };
        if number != self.packet {
            return Err(FileErrorCode::PacketNumber);
        }
        self.turn = if last {
            files.finish();
            Turn::Idle
        } else {
            Turn::Reading
        };
        Ok(())
    }

    /// The next message, if the application has done its part; `room` as in [`request`](Self::request).
    pub fn next(&mut self, files: &mut impl Files, room: usize, now: Instant) -> Option<Payload> {
        let outcome = match self.turn {
            Turn::Opening(transfer) => files.done()?.map(|()| self.opened(transfer)),
            Turn::Storing(step) => match files.done() {
                Some(done) => done.map(|()| self.stored(step, files)),
                None => return self.busy(step, now),
            },
            Turn::Reading => self.read(files, room)?.map(Some),
            Turn::Idle | Turn::Receiving | Turn::Busy(_) | Turn::Sent { .. } => return None,
        };
        match outcome {
            // The application has something else to do first.
            Ok(None) => self.next(files, room, now),
            Ok(Some(message)) => {
                self.since = now;
                Some(message)
            }
            Err(error) => {
                self.turn = Turn::Idle;
                Some(refusal(&error, room))
            }
        }
    }

    fn opened(&mut self, transfer: Transfer) -> Option<Payload> {
        match transfer {
            Transfer::Read => {
                self.turn = Turn::Reading;
                None
            }
            Transfer::Write => {
                self.turn = Turn::Receiving;
                Some(self.ack())
            }
        }
    }

    fn stored(&mut self, step: Step, files: &mut impl Files) -> Option<Payload> {
        self.turn = match step {
            Step::Store => Turn::Receiving,
            Step::StoreLast => {
                files.finish();
                self.turn = Turn::Storing(Step::Finish);
                return None;
            }
            Step::Finish | Step::FinishEmpty => Turn::Idle,
        };
        Some(self.ack())
    }

    fn read(&mut self, files: &mut impl Files, room: usize) -> Option<Result<Payload, FileError>> {
        let mut buffer = [0; PACKET_BYTES_MAX];
        let bytes = buffer.get_mut(..room - HEADER_BYTES)?;
        let read = match files.read(bytes)? {
            Ok(read) => bytes.get(..read).unwrap_or(bytes),
            Err(error) => return Some(Err(error)),
        };
        self.packet = self.packet.wrapping_add(1);
        self.turn = Turn::Sent { last: read.len() < room - HEADER_BYTES };
        self.data = Operation::Data.message(self.packet, read, room);
        Some(Ok(self.data.clone()))
    }

    fn ack(&self) -> Payload {
        Operation::Ack.message(self.packet, &[], HEADER_BYTES)
    }

    /// Tells the MainDevice after a while that the packet takes longer. Not about an empty one: SOEM would take that for success.
    fn busy(&mut self, step: Step, now: Instant) -> Option<Payload> {
        if step == Step::FinishEmpty || now < self.since + BUSY_AFTER {
            return None;
        }
        (self.turn, self.since) = (Turn::Busy(step), now);
        Some(Operation::Busy.message(NOTHING_OF_ONE, &[], HEADER_BYTES))
    }

    /// Whether the application has something to do, so that [`next`](Self::next) must look for its end.
    pub fn is_working(&self) -> bool {
        matches!(self.turn, Turn::Opening(_) | Turn::Storing(_) | Turn::Reading)
    }

    /// Ends a transfer whose MainDevice takes too long.
    pub fn expire(&mut self, files: &mut impl Files, now: Instant) {
        if !self.is_working() && now >= self.since + ABANDONED_AFTER {
            self.end(files);
        }
    }

    /// Ends a transfer.
    pub fn end(&mut self, files: &mut impl Files) {
        if self.turn != Turn::Idle {
            files.abort();
        }
        self.turn = Turn::Idle;
    }
}

fn refusal(error: &FileError, room: usize) -> Payload {
    let text = error.text.as_bytes();
    Operation::Error.message(error.code as u32, text, room)
}
