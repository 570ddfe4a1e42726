//! What the emulator does for the board: files of the host, the command line, log lines, the end.

use core::fmt::Write as _;

use cortex_m_semihosting::{debug, hprint, nr, syscall};
use heapless::String;
use log::{Level, LevelFilter, Log, Metadata, Record};

/// What a call gives when it could not be done.
const FAILED: usize = usize::MAX;
/// Longest command line.
const COMMAND_LINE_BYTES_MAX: usize = 512;

/// A file of the host.
pub(crate) struct File(usize);

/// A call that the host could not carry out.
#[derive(Debug)]
pub(crate) struct HostError;

impl File {
    /// Opens `path` (which ends in NUL) in a mode of `cortex_m_semihosting::nr::open`.
    fn open(path: &[u8], mode: usize) -> Option<Self> {
        // SAFETY: pointer and length are those of a slice that outlives the call; so in all calls here.
        let handle = unsafe { syscall!(OPEN, path.as_ptr(), mode, path.len() - 1) };
        (handle != FAILED).then_some(Self(handle))
    }

    /// The file that the command line's second word names, for reading and writing; made if there is none.
    pub(crate) fn named_by_command_line() -> Result<Self, HostError> {
        Self::second_word().ok_or(HostError)
    }

    fn second_word() -> Option<Self> {
        let mut line = [0_u8; COMMAND_LINE_BYTES_MAX];
        let mut block = [line.as_mut_ptr() as usize, line.len()];
        // SAFETY: the host writes the line, and its length into the block, which is mutable for that.
        let status = unsafe { cortex_m_semihosting::syscall1(nr::GET_CMDLINE, block.as_mut_ptr() as usize) };
        let length = core::hint::black_box(block)[1];
        let line = line.get_mut(..=length).filter(|_| status == 0)?;
        let word = line.iter().position(|byte| *byte == b' ')? + 1;
        let path = line.get(word..)?;
        Self::open(path, nr::open::RW_BINARY).or_else(|| Self::open(path, nr::open::RW_TRUNC_BINARY))
    }

    pub(crate) fn length(&self) -> usize {
        // SAFETY: as in `open`.
        unsafe { syscall!(FLEN, self.0) }
    }

    pub(crate) fn read(&mut self, offset: u32, into: &mut [u8]) -> Result<(), HostError> {
        // SAFETY: as in `open`. Both calls give 0 when all went well.
        let missing =
            unsafe { syscall!(SEEK, self.0, offset) | syscall!(READ, self.0, into.as_mut_ptr(), into.len()) };
        if missing == 0 { Ok(()) } else { Err(HostError) }
    }

    pub(crate) fn write(&mut self, offset: u32, from: &[u8]) -> Result<(), HostError> {
        // SAFETY: as in `open`.
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
            // A line that is too long lacks its end.
            let _ = writeln!(line, "{}: {}", record.level(), record.args());
            hprint!(&line);
        }
    }

    fn flush(&self) {}
}

/// Lets the log go to the host's standard output.
pub(crate) fn start_log() {
    // It is the first and only logger.
    let _ = log::set_logger(&HostLog);
    log::set_max_level(LevelFilter::Info);
}

/// Seconds of the host's clock.
pub(crate) fn host_time() -> usize {
    // SAFETY: the call takes nothing and gives a number.
    unsafe { syscall!(TIME) }
}

/// Ends the emulator with a status that is not 0.
pub(crate) fn fail() -> ! {
    loop {
        debug::exit(debug::EXIT_FAILURE);
    }
}
