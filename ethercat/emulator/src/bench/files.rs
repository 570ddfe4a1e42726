//! The bench's files: kept in memory, with flash memory's delays and faults.

use std::collections::BTreeMap;

use embassy_time::{Duration, Instant};
use ethercat_subdevice::al_state::AlState;
use ethercat_subdevice::foe::{FileError, FileErrorCode, Files, Opening, Transfer};

/// Files that begin with this are for Boot, all others for other states.
pub const FIRMWARE: &str = "firmware";
/// The password of firmware.
pub const PASSWORD: u32 = 0x1234_5678;
/// Most bytes of a file.
pub const FILE_BYTES_MAX: usize = 100_000;

/// The files of the bench's application.
#[derive(Default)]
pub struct BenchFiles {
    /// The finished ones, by name.
    pub stored: BTreeMap<String, Vec<u8>>,
    /// How long each call takes.
    pub delay: Duration,
    /// Number of calls to `write`.
    pub writes: usize,
    /// Number of files closed by `finish`.
    pub finished: usize,
    /// Number of files closed by `abort`.
    pub aborted: usize,
    /// A result of `finish`.
    pub unfit: Option<FileError>,
    open: Option<Open>,
    begun: Option<Instant>,
    refused: Option<FileError>,
}

struct Open {
    transfer: Transfer,
    name: String,
    bytes: Vec<u8>,
    read: usize,
}

impl BenchFiles {
    /// Whether a file is open.
    pub fn is_open(&self) -> bool {
        self.open.is_some()
    }

    fn opened(&self, opening: &Opening<'_>) -> Result<Vec<u8>, FileError> {
        let firmware = opening.name.starts_with(FIRMWARE);
        match (firmware, opening.state == AlState::Boot) {
            (true, false) => return Err(FileErrorCode::BootstrapOnly.into()),
            (false, true) => return Err(FileErrorCode::NotInBootstrap.into()),
            (true, true) if opening.password != PASSWORD => return Err(FileErrorCode::NoRights.into()),
            _ => {}
        }
        match opening.transfer {
            Transfer::Write => Ok(Vec::new()),
            Transfer::Read => {
                let missing = || FileError::new(FileErrorCode::NotFound, format!("no {}", opening.name));
                self.stored.get(opening.name).cloned().ok_or_else(missing)
            }
        }
    }

    fn is_busy(&mut self) -> bool {
        let begun = *self.begun.get_or_insert_with(Instant::now);
        let busy = Instant::now() < begun + self.delay;
        if !busy {
            self.begun = None;
        }
        busy
    }

    fn fail(&mut self) -> Option<FileError> {
        let failed = self.refused.take()?;
        self.open = None;
        Some(failed)
    }
}

impl Files for BenchFiles {
    fn open(&mut self, opening: &Opening<'_>) {
        assert!(self.open.is_none(), "one file at a time");
        self.begun = Some(Instant::now());
        match self.opened(opening) {
            Ok(bytes) => {
                let (transfer, name) = (opening.transfer, opening.name.to_owned());
                self.open = Some(Open { transfer, name, bytes, read: 0 });
            }
            Err(error) => self.refused = Some(error),
        }
    }

    fn write(&mut self, bytes: &[u8]) {
        let open = self.open.as_mut().expect("a file is open");
        (self.writes, self.begun) = (self.writes + 1, Some(Instant::now()));
        open.bytes.extend(bytes);
        if open.bytes.len() > FILE_BYTES_MAX {
            self.refused = Some(FileErrorCode::DiskFull.into());
        }
    }

    fn finish(&mut self) {
        let open = self.open.take().expect("a file is open");
        (self.finished, self.begun) = (self.finished + 1, Some(Instant::now()));
        match self.unfit.clone() {
            _ if open.transfer == Transfer::Read => self.begun = None,
            Some(error) => self.refused = Some(error),
            None => drop(self.stored.insert(open.name, open.bytes)),
        }
    }

    fn done(&mut self) -> Option<Result<(), FileError>> {
        (!self.is_busy()).then(|| self.fail().map_or(Ok(()), Err))
    }

    fn read(&mut self, into: &mut [u8]) -> Option<Result<usize, FileError>> {
        if self.is_busy() {
            return None;
        }
        let open = self.open.as_mut().expect("a file is open");
        let rest = &open.bytes[open.read..];
        let length = rest.len().min(into.len());
        into[..length].copy_from_slice(&rest[..length]);
        open.read += length;
        Some(Ok(length))
    }

    fn abort(&mut self) {
        self.aborted += 1;
        (self.open, self.begun, self.refused) = (None, None, None);
    }
}
