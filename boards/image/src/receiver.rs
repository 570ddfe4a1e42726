//! Takes an update file in pieces as they arrive, and says early what is wrong with it.

use thiserror::Error;

use crate::header::{HEADER_BYTES, Header, MAGIC};
use crate::info::{INFO_BYTES, INFO_OFFSET, Info};
use crate::version::Version;

/// Bytes of a file after which it is known whether it is for this board and not older.
pub const DECIDED_BYTES: usize = HEADER_BYTES + FIRMWARE_BYTES_MIN as usize;
/// A firmware at least has its info block.
const FIRMWARE_BYTES_MIN: u32 = (INFO_OFFSET + INFO_BYTES) as u32;

/// Why a file is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum Refused {
    /// It does not begin as an update file does, or its firmware has no info block.
    #[error("this is not an image of mobgate's firmware")]
    NotAnImage,
    /// The firmware has more bytes than there is room for.
    #[error("the image has {bytes} bytes, there is room for {bytes_max}")]
    TooLarge {
        /// Bytes of the firmware.
        bytes: u32,
        /// Bytes that there is room for.
        bytes_max: u32,
    },
    /// The firmware is another board's.
    #[error("the image is for another board, {}", .0.board())]
    OtherBoard(Info),
    /// The firmware is older than the one that runs.
    #[error("the image has version {0}, which is older than what runs")]
    Older(Version),
    /// The file ended before the firmware did.
    #[error("{missing_bytes} bytes of the image are missing")]
    Truncated {
        /// Bytes of the firmware that are missing.
        missing_bytes: u32,
    },
    /// Something follows the firmware.
    #[error("the file goes on after the image")]
    TooLong,
}

/// Receives one update file.
#[derive(Debug)]
pub struct Receiver {
    running: Info,
    firmware_bytes_max: u32,
    older: bool,
    header: Gathered<HEADER_BYTES>,
    info: Gathered<INFO_BYTES>,
    /// Bytes of the firmware so far.
    firmware_bytes: u32,
    refused: Option<Refused>,
}

impl Receiver {
    /// Nothing received yet, for the board that `running` names. With `older`, a firmware may have a lower version than `running`.
    pub const fn new(running: Info, firmware_bytes_max: u32, older: bool) -> Self {
        Self {
            running,
            firmware_bytes_max,
            older,
            header: Gathered::new(),
            info: Gathered::new(),
            firmware_bytes: 0,
            refused: None,
        }
    }

    /// Takes the next bytes of the file, any number of them, and returns those of them that are firmware, which are to be written
    /// behind those before.
    ///
    /// # Errors
    ///
    /// The file is refused, by these bytes or by ones before.
    pub fn take<'b>(&mut self, bytes: &'b [u8]) -> Result<&'b [u8], Refused> {
        let taken = self.refused.map_or_else(|| self.check(bytes), Err);
        self.refused = taken.err();
        taken
    }

    /// The firmware's board and version, once its first bytes are there.
    pub fn info(&self) -> Option<Info> {
        Info::from_bytes(self.info.whole()?)
    }

    /// Bytes of the firmware that were received, and that it has; for showing progress.
    pub fn progress(&self) -> (u32, Option<u32>) {
        (self.firmware_bytes, self.header().map(|header| header.firmware_bytes))
    }

    /// The file has ended: what is left to check is the signature in the header.
    ///
    /// # Errors
    ///
    /// The file was refused before, or bytes are missing.
    pub fn finish(&self) -> Result<(Header, Info), Refused> {
        if let Some(refused) = self.refused {
            return Err(refused);
        }
        let header = self.header().ok_or(Refused::NotAnImage)?;
        match header.firmware_bytes.saturating_sub(self.firmware_bytes) {
            0 => Ok((header, self.info().ok_or(Refused::NotAnImage)?)),
            missing_bytes => Err(Refused::Truncated { missing_bytes }),
        }
    }

    fn header(&self) -> Option<Header> {
        Header::from_bytes(self.header.whole()?)
    }

    fn check<'b>(&mut self, bytes: &'b [u8]) -> Result<&'b [u8], Refused> {
        let firmware = self.header.take(bytes);
        let begin = self.header.so_far();
        if !begin.iter().zip(MAGIC).all(|(byte, of_magic)| byte == of_magic) {
            return Err(Refused::NotAnImage);
        }
        let Some(Header { firmware_bytes: whole, .. }) = self.header() else { return Ok(firmware) };
        if whole < FIRMWARE_BYTES_MIN {
            return Err(Refused::NotAnImage);
        }
        if whole > self.firmware_bytes_max {
            return Err(Refused::TooLarge { bytes: whole, bytes_max: self.firmware_bytes_max });
        }
        let before = usize::try_from(self.firmware_bytes).unwrap_or(usize::MAX);
        if let Some(from_info) = firmware.get(INFO_OFFSET.saturating_sub(before)..) {
            self.info.take(from_info);
            self.check_info()?;
        }
        let now = u32::try_from(firmware.len()).ok().and_then(|more| self.firmware_bytes.checked_add(more));
        self.firmware_bytes = now.filter(|now| *now <= whole).ok_or(Refused::TooLong)?;
        Ok(firmware)
    }

    fn check_info(&self) -> Result<(), Refused> {
        let Some(bytes) = self.info.whole() else { return Ok(()) };
        let info = Info::from_bytes(bytes).ok_or(Refused::NotAnImage)?;
        if info.board() != self.running.board() {
            return Err(Refused::OtherBoard(info));
        }
        if info.version() < self.running.version() && !self.older {
            return Err(Refused::Older(info.version()));
        }
        Ok(())
    }
}

/// The first `N` bytes of what arrives in pieces.
#[derive(Debug)]
struct Gathered<const N: usize> {
    bytes: [u8; N],
    count: usize,
}

impl<const N: usize> Gathered<N> {
    const fn new() -> Self {
        Self { bytes: [0; N], count: 0 }
    }

    /// Takes what is missing of the next bytes, and returns the rest of them.
    fn take<'b>(&mut self, bytes: &'b [u8]) -> &'b [u8] {
        let free = self.bytes.get_mut(self.count..).unwrap_or_default();
        let (taken, rest) = bytes.split_at_checked(free.len()).unwrap_or((bytes, &[]));
        free.iter_mut().zip(taken).for_each(|(to, from)| *to = *from);
        self.count += taken.len();
        rest
    }

    fn so_far(&self) -> &[u8] {
        self.bytes.get(..self.count).unwrap_or_default()
    }

    fn whole(&self) -> Option<&[u8; N]> {
        (self.count == N).then_some(&self.bytes)
    }
}
