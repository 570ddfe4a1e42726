//! Services of the emulator: host files, the command line, log lines, exit.

use core::fmt::Write as _;

use cortex_m_semihosting::{debug, hprint, nr, syscall};
use heapless::String;
use log::{Level, LevelFilter, Log, Metadata, Record};

/// Result of a failed call.
const FAILED: usize = usize::MAX;
/// Longest command line.
const COMMAND_LINE_BYTES_MAX: usize = 512;

/// The command line: `mobgate FLASH [WORD]...`, where FLASH is the file with the settings.
pub(crate) struct CommandLine(String<COMMAND_LINE_BYTES_MAX>);

impl CommandLine {
    /// Reads it; empty if it is too long.
    pub(crate) fn read() -> Self {
        let mut line = [0_u8; COMMAND_LINE_BYTES_MAX];
        let mut block = [line.as_mut_ptr() as usize, line.len()];
        // SAFETY: the host writes the line, and its length into the block, which is mutable for that purpose.
        let status = unsafe { cortex_m_semihosting::syscall1(nr::GET_CMDLINE, block.as_mut_ptr() as usize) };
        let length = core::hint::black_box(block)[1];
        let line = line.get(..length).filter(|_| status == 0).unwrap_or_default();
        let words = core::str::from_utf8(line).unwrap_or_default().trim_end_matches('\0');
        Self(words.try_into().unwrap_or_default())
    }

    /// The words after the program's name.
    pub(crate) fn words(&self) -> impl Iterator<Item = &str> {
        self.0.split_whitespace().skip(1)
    }

    /// The flash file.
    pub(crate) fn flash(&self) -> Option<&str> {
        self.words().next()
    }

    /// Whether this word is present.
    pub(crate) fn has(&self, word: &str) -> bool {
        self.words().skip(1).any(|found| found == word)
    }
}

/// A file on the host.
pub(crate) struct File(pub(crate) usize);

/// A failed host call.
#[derive(Debug)]
pub(crate) struct HostError;

impl File {
    /// Opens `path` with a suffix, in a mode of `cortex_m_semihosting::nr::open`.
    pub(crate) fn open_as(path: &str, end: &str, mode: usize) -> Result<Self, HostError> {
        let mut name = String::<{ COMMAND_LINE_BYTES_MAX + 8 }>::new();
        write!(name, "{path}{end}\0").map_err(|_| HostError)?;
        // SAFETY: pointer and length belong to a text that outlives the call; this holds for all calls here.
        let handle = unsafe { syscall!(OPEN, name.as_ptr(), mode, name.len() - 1) };
        if handle == FAILED { Err(HostError) } else { Ok(Self(handle)) }
    }

    /// Opens a file for reading and writing; creates it if necessary.
    pub(crate) fn open(path: &str) -> Result<Self, HostError> {
        Self::open_as(path, "", nr::open::RW_BINARY)
            .or_else(|_| Self::open_as(path, "", nr::open::RW_TRUNC_BINARY))
    }

    pub(crate) fn length(&self) -> usize {
        // SAFETY: as in `open_as`.
        unsafe { syscall!(FLEN, self.0) }
    }

    pub(crate) fn read(&mut self, offset: u32, into: &mut [u8]) -> Result<(), HostError> {
        // SAFETY: as in `open_as`. Both calls return 0 on success.
        let missing =
            unsafe { syscall!(SEEK, self.0, offset) | syscall!(READ, self.0, into.as_mut_ptr(), into.len()) };
        if missing == 0 { Ok(()) } else { Err(HostError) }
    }

    /// Reads what comes next; of a file without a beginning, too.
    pub(crate) fn read_next(&mut self, into: &mut [u8]) -> Result<(), HostError> {
        // SAFETY: as in `open_as`. The call returns 0 on success.
        let missing = unsafe { syscall!(READ, self.0, into.as_mut_ptr(), into.len()) };
        if missing == 0 { Ok(()) } else { Err(HostError) }
    }

    pub(crate) fn write(&mut self, offset: u32, from: &[u8]) -> Result<(), HostError> {
        // SAFETY: as in `open_as`.
        let missing =
            unsafe { syscall!(SEEK, self.0, offset) | syscall!(WRITE, self.0, from.as_ptr(), from.len()) };
        if missing == 0 { Ok(()) } else { Err(HostError) }
    }
}

struct HostLog;

impl Log for HostLog {
    fn enabled(&self, metadata: &Metadata) -> bool {
        metadata.level() <= Level::Info
    }

    fn log(&self, record: &Record) {
        if self.enabled(record.metadata()) {
            let mut line = String::<200>::new();
            // A line that is too long is truncated.
            let _ = writeln!(line, "{}: {}", record.level(), record.args());
            hprint!(&line);
        }
    }

    fn flush(&self) {}
}

/// Sends the log to the host's standard output.
pub(crate) fn start_log() {
    // It is the first and only logger.
    let _ = log::set_logger(&HostLog);
    log::set_max_level(LevelFilter::Info);
}

/// The host's time in seconds.
pub(crate) fn host_time() -> usize {
    // SAFETY: the call takes no arguments and returns a number.
    unsafe { syscall!(TIME) }
}

/// Random numbers of the host: an emulated board has none of its own.
pub(crate) fn random(into: &mut [u8]) -> Result<(), HostError> {
    let mut source = File::open_as("/dev/urandom", "", nr::open::R_BINARY)?;
    let read = source.read_next(into);
    // SAFETY: the file is open, and nobody uses it afterwards.
    unsafe { syscall!(CLOSE, source.0) };
    read
}

/// Exits the emulator with a non-zero status.
pub(crate) fn fail() -> ! {
    loop {
        debug::exit(debug::EXIT_FAILURE);
    }
}
