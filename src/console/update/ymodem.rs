//! The receiver of YMODEM (Forsberg, "XMODEM/YMODEM Protocol Reference", 1988), as `sb` of lrzsz, minicom and Tera Term send it.
//!
//! `C` asks for a file. Block 0 has its name and its length, then blocks of 128 or 1024 bytes follow, each with its number, the
//! number's complement and a CRC-16; each is acknowledged, or asked for again. EOT ends the file, a block 0 without a name the
//! transfer. No I/O and no time here: [`Receiver::feed`] takes bytes, [`Receiver::silence`] their absence.

use crc::{CRC_16_XMODEM, Crc, NoTable};
use embassy_time::Duration;

const CRC: Crc<u16, NoTable> = Crc::<u16, NoTable>::new(&CRC_16_XMODEM);

/// Begins a block of 128 bytes.
const SOH: u8 = 0x01;
/// Begins a block of 1024 bytes.
const STX: u8 = 0x02;
const CTRL_C: u8 = 0x03;
const EOT: u8 = 0x04;
const ACK: u8 = 0x06;
const NAK: u8 = 0x15;
const CAN: u8 = 0x18;
/// Asks for a file with CRC-16.
const ASK: u8 = b'C';

/// Ends the transfer at the sender, whatever it waits for; two of them suffice.
pub(super) const CANCEL: &[u8] = &[CAN; 8];

/// First byte, number, and the number's complement.
const HEAD_BYTES: usize = 3;
const CRC_BYTES: usize = 2;
const SHORT_BYTES: usize = 128;
const LONG_BYTES: usize = 1024;
const BLOCK_BYTES_MAX: usize = HEAD_BYTES + LONG_BYTES + CRC_BYTES;

/// How often a file is asked for, for two minutes.
const ASKED_MAX: u32 = 40;
const ASK_EVERY: Duration = Duration::from_secs(3);
/// Corrupt or missing blocks in a row.
const FAILED_MAX: u32 = 10;
/// How long the next block may take.
const BLOCK_WITHIN: Duration = Duration::from_secs(5);
/// How long the next byte of a block may take.
const BYTE_WITHIN: Duration = Duration::from_secs(1);
/// The silence after which the rest of a corrupt block is over.
const OVER_AFTER: Duration = Duration::from_millis(200);

/// What to do after a byte or a silence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Action {
    /// Nothing.
    More,
    /// To send these bytes.
    Send(&'static [u8]),
    /// To begin a file of this length, if it is known; then [`Receiver::accepted`].
    Begin(Option<u32>),
    /// To write [`Receiver::data`]; then [`Receiver::accepted`].
    Data,
    /// To finish the file; then [`Receiver::accepted`].
    Finish,
    /// To send these bytes, which end the transfer.
    Done(&'static [u8]),
    /// To give up.
    Stopped(Stopped),
}

/// Why a transfer ended early.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(in crate::console) enum Stopped {
    #[error("no file came")]
    NoFile,
    #[error("cancelled")]
    Cancelled,
    #[error("the transfer broke off")]
    Silent,
    #[error("a block is missing")]
    OutOfOrder,
    #[error("one file at a time")]
    SecondFile,
}

/// What comes next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Next {
    /// Block 0 of the file.
    File,
    /// The file's block of this number; 1 is also the first one.
    Block(u8),
    /// Block 0 without a name.
    End,
}

/// The beginning of what arrives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Arriving {
    /// Nothing.
    Nothing,
    /// A block.
    Block,
    /// One byte of two that cancel.
    Cancel,
    /// The rest of what is corrupt.
    Rest,
}

/// A transfer.
pub(super) struct Receiver {
    next: Next,
    arriving: Arriving,
    /// How often a file was asked for, or failures in a row.
    tries: u32,
    /// Whether EOT came, and was doubted.
    doubted: bool,
    /// Bytes of the file still to come, if known.
    left: Option<u32>,
    filled: usize,
    block: [u8; BLOCK_BYTES_MAX],
}

impl Receiver {
    pub(super) const fn new() -> Self {
        Self {
            next: Next::File,
            arriving: Arriving::Rest,
            tries: 0,
            doubted: false,
            left: None,
            filled: 0,
            block: [0; BLOCK_BYTES_MAX],
        }
    }

    /// How long to wait for the next byte.
    pub(super) fn patience(&self) -> Duration {
        match (self.arriving, self.next) {
            (Arriving::Rest, _) => OVER_AFTER,
            (Arriving::Block | Arriving::Cancel, _) => BYTE_WITHIN,
            (Arriving::Nothing, Next::File) => ASK_EVERY,
            (Arriving::Nothing, Next::Block(_) | Next::End) => BLOCK_WITHIN,
        }
    }

    /// The bytes of the file in the last block.
    pub(super) fn data(&self) -> &[u8] {
        let payload = self.payload();
        let count = self.left.map_or(payload.len(), |left| payload.len().min(left as usize));
        payload.get(..count).unwrap_or(payload)
    }

    /// Takes the next byte.
    pub(super) fn feed(&mut self, byte: u8) -> Action {
        match (self.arriving, byte) {
            (Arriving::Rest, _) => Action::More,
            (Arriving::Cancel, CAN) | (Arriving::Nothing, CTRL_C) => Action::Stopped(Stopped::Cancelled),
            (Arriving::Block, _) => self.extend(byte),
            (Arriving::Nothing, SOH | STX) => {
                (self.arriving, self.filled) = (Arriving::Block, 0);
                self.extend(byte)
            }
            (Arriving::Nothing, CAN) => {
                self.arriving = Arriving::Cancel;
                Action::More
            }
            (Arriving::Nothing, EOT) => self.end_of_file(),
            (Arriving::Nothing | Arriving::Cancel, _) => {
                self.arriving = Arriving::Rest;
                Action::More
            }
        }
    }

    /// Nothing came for as long as [`patience`](Self::patience).
    pub(super) fn silence(&mut self) -> Action {
        self.arriving = Arriving::Nothing;
        self.tries += 1;
        match self.next {
            Next::File if self.tries > ASKED_MAX => Action::Stopped(Stopped::NoFile),
            // The file is whole already.
            Next::End if self.tries > 1 => Action::Done(&[]),
            _ if self.tries > FAILED_MAX && self.next != Next::File => Action::Stopped(Stopped::Silent),
            Next::File | Next::End => Action::Send(&[ASK]),
            Next::Block(_) => Action::Send(&[NAK]),
        }
    }

    /// Goes on after what [`feed`](Self::feed) returned was done; returns the bytes to send.
    pub(super) fn accepted(&mut self) -> &'static [u8] {
        self.tries = 0;
        match self.next {
            Next::File => {
                self.next = Next::Block(1);
                &[ACK, ASK]
            }
            Next::Block(_) if self.doubted => {
                self.next = Next::End;
                &[ACK, ASK]
            }
            Next::Block(number) => {
                let count = self.data().len() as u32;
                self.left = self.left.map(|left| left.saturating_sub(count));
                self.next = Next::Block(number.wrapping_add(1));
                &[ACK]
            }
            Next::End => &[ACK],
        }
    }

    fn payload(&self) -> &[u8] {
        self.block.get(HEAD_BYTES..self.filled.saturating_sub(CRC_BYTES)).unwrap_or_default()
    }

    fn extend(&mut self, byte: u8) -> Action {
        if let Some(place) = self.block.get_mut(self.filled) {
            *place = byte;
            self.filled += 1;
        }
        let length = if self.block.first() == Some(&SOH) { SHORT_BYTES } else { LONG_BYTES };
        if self.filled < HEAD_BYTES + length + CRC_BYTES {
            return Action::More;
        }
        let &[_, number, complement, ..] = &self.block;
        let checked = self.block.get(HEAD_BYTES..self.filled).unwrap_or_default();
        if number != !complement || CRC.checksum(checked) != 0 {
            self.arriving = Arriving::Rest;
            return Action::More;
        }
        self.arriving = Arriving::Nothing;
        self.take(number)
    }

    /// Takes the block of this number.
    fn take(&mut self, number: u8) -> Action {
        match (self.next, number) {
            (Next::File, 0) => self.begin(),
            (Next::Block(next), _) if number == next => {
                self.doubted = false;
                Action::Data
            }
            // An acknowledgement was lost, and the block came again.
            (Next::Block(1), 0) => Action::Send(&[ACK, ASK]),
            (Next::Block(next), _) if number == next.wrapping_sub(1) => Action::Send(&[ACK]),
            (Next::End, 0) if self.payload().first() == Some(&0) => Action::Done(&[ACK]),
            (Next::End, 0) => Action::Stopped(Stopped::SecondFile),
            (Next::File | Next::Block(_) | Next::End, _) => Action::Stopped(Stopped::OutOfOrder),
        }
    }

    /// Block 0: the name, a zero, the length in decimal, and what is of no interest.
    fn begin(&mut self) -> Action {
        let mut fields = self.payload().splitn(2, |byte| *byte == 0);
        if fields.next().is_none_or(<[u8]>::is_empty) {
            return Action::Stopped(Stopped::NoFile);
        }
        let length = fields.next().unwrap_or_default();
        let length = length.split(|byte| !byte.is_ascii_digit()).next().unwrap_or_default();
        self.left = str::from_utf8(length).ok().and_then(|length| length.parse().ok());
        Action::Begin(self.left)
    }

    /// EOT may also be a block's first byte that was corrupted: unless the length says that the file is whole, it must come twice.
    fn end_of_file(&mut self) -> Action {
        match self.next {
            Next::Block(_) if self.doubted || self.left == Some(0) => {
                self.doubted = true;
                Action::Finish
            }
            Next::Block(_) => {
                self.doubted = true;
                Action::Send(&[NAK])
            }
            // Its acknowledgement was lost.
            Next::End => Action::Send(&[ACK, ASK]),
            // A key.
            Next::File => {
                self.arriving = Arriving::Rest;
                Action::More
            }
        }
    }
}

#[cfg(test)]
mod tests;
