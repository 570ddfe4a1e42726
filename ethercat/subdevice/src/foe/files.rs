//! What an application adds to FoE: its files.

use core::fmt::{self, Write};

use heapless::String;

use crate::al_state::AlState;

/// Most bytes of the text of a [`FileError`]; a small mailbox carries fewer.
pub const TEXT_BYTES_MAX: usize = 96;

/// The files of an application. The SubDevice's task makes the calls; none of them blocks.
///
/// One file is open at a time. [`open`](Self::open), [`write`](Self::write) and [`finish`](Self::finish) begin something whose
/// result [`done`](Self::done) tells, and nothing else is begun before. Flash memory that is slow just lets [`done`](Self::done)
/// wait: the MainDevice is told to be patient.
pub trait Files {
    /// Opens a file at its beginning.
    fn open(&mut self, opening: &Opening<'_>);

    /// Stores the next bytes of the file that is written: as many as a mailbox holds, fewer at the end of the file.
    fn write(&mut self, bytes: &[u8]);

    /// Ends a file: all its bytes were written, and take effect if it is fit for that; or all of them were read, and no result is
    /// asked for.
    fn finish(&mut self);

    /// The result of what was begun last; `None` while it is in progress. After an error the file is not open any more.
    fn done(&mut self) -> Option<Result<(), FileError>>;

    /// Writes the next bytes of the file that is read into `into`, and returns their number: fewer than `into` has only at the end
    /// of the file. `None` while they are not there yet. After an error the file is not open any more.
    fn read(&mut self, into: &mut [u8]) -> Option<Result<usize, FileError>>;

    /// Closes a file that was not finished, whatever is in progress: its transfer was abandoned.
    fn abort(&mut self);
}

/// A file to open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Opening<'a> {
    /// What happens to it.
    pub transfer: Transfer,
    /// Its name.
    pub name: &'a str,
    /// The MainDevice's password; 0 is none.
    pub password: u32,
    /// The SubDevice's state, for files that are open in some only. The transfer ends with it.
    pub state: AlState,
}

/// What a MainDevice does with a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transfer {
    /// Reads it.
    Read,
    /// Writes it.
    Write,
}

/// Why a file cannot be read or written (ETG.1000.6, clause 5.8; the numbers from 800Ch on are of ETG.1020). Its text goes to the
/// MainDevice unless there is a better one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[repr(u32)]
pub enum FileErrorCode {
    /// No more specific code applies.
    #[error("failed")]
    NotDefined = 0x8000,
    /// There is no such file.
    #[error("no such file")]
    NotFound = 0x8001,
    /// The file cannot be read, or not be written, or not now.
    #[error("no access")]
    AccessDenied = 0x8002,
    /// It is too long.
    #[error("too long")]
    DiskFull = 0x8003,
    /// A message that does not fit what came before.
    #[error("not expected now")]
    Illegal = 0x8004,
    /// A packet is missing, or came twice.
    #[error("wrong packet number")]
    PacketNumber = 0x8005,
    /// A file of that name exists already.
    #[error("exists already")]
    Exists = 0x8006,
    /// No user.
    #[error("no user")]
    NoUser = 0x8007,
    /// The file is for the Boot state.
    #[error("in Boot only")]
    BootstrapOnly = 0x8008,
    /// The file is for other states than Boot.
    #[error("not in Boot")]
    NotInBootstrap = 0x8009,
    /// The password is wrong.
    #[error("wrong password")]
    NoRights = 0x800a,
    /// The program failed.
    #[error("program error")]
    ProgramError = 0x800b,
    /// A checksum in the file, or a signature, is wrong.
    #[error("wrong checksum")]
    InvalidChecksum = 0x800c,
    /// The firmware is for other hardware.
    #[error("not for this hardware")]
    InvalidFirmware = 0x800d,
    /// The file's header is missing or wrong.
    #[error("no valid file header")]
    InvalidHeader = 0x8010,
    /// The flash memory failed.
    #[error("the flash failed")]
    FlashFailed = 0x8011,
}

/// A file error, with a text for the user.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileError {
    /// The code.
    pub code: FileErrorCode,
    /// The text, which users see in the MainDevice's tool.
    pub text: String<TEXT_BYTES_MAX>,
}

impl FileError {
    /// An error with a text of its own, which is cut off at [`TEXT_BYTES_MAX`].
    pub fn new(code: FileErrorCode, text: impl fmt::Display) -> Self {
        let mut cut = Cut(String::new());
        // What does not fit is left out.
        let _ = write!(cut, "{text}");
        Self { code, text: cut.0 }
    }
}

impl From<FileErrorCode> for FileError {
    fn from(code: FileErrorCode) -> Self {
        Self::new(code, code)
    }
}

/// A text that keeps what fits.
struct Cut(String<TEXT_BYTES_MAX>);

impl Write for Cut {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        text.chars().try_for_each(|letter| self.0.push(letter).map_err(|_| fmt::Error))
    }
}

/// The files of an application that has none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NoFiles;

impl Files for NoFiles {
    fn open(&mut self, _opening: &Opening<'_>) {}

    fn write(&mut self, _bytes: &[u8]) {}

    fn finish(&mut self) {}

    fn done(&mut self) -> Option<Result<(), FileError>> {
        Some(Err(FileErrorCode::NotFound.into()))
    }

    fn read(&mut self, _into: &mut [u8]) -> Option<Result<usize, FileError>> {
        Some(Err(FileErrorCode::NotFound.into()))
    }

    fn abort(&mut self) {}
}

#[cfg(test)]
mod tests {
    use super::{FileError, FileErrorCode, TEXT_BYTES_MAX};

    #[test]
    fn a_long_text_is_cut_off_between_letters() {
        let error = FileError::new(FileErrorCode::NotFound, "ä".repeat(TEXT_BYTES_MAX));
        assert_eq!(error.text.as_str(), "ä".repeat(TEXT_BYTES_MAX / 2));
        let error = FileError::from(FileErrorCode::NoRights);
        assert_eq!((error.code as u32, error.text.as_str()), (0x800a, "wrong password"));
    }
}
