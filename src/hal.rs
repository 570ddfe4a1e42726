//! The board's interface: serial lines, TCP and UDP sockets, storage for settings, new firmware, and information about the board.
//!
//! A board implements these traits for its hardware; the core's port tasks own the implementors and open what the settings name.
//! Everything is polled from one executor, so no trait requires `Send`.

use core::fmt;

use embassy_time::{Duration, Instant};
use embedded_io_async::{Read, Write};

use crate::settings::{Certificate, LineSettings, PasswordHash, StaticAddress};

mod network;
mod relay;
mod syslog;
mod update;

pub use self::network::{SocketLost, TcpConnect, TcpHost, TcpStream, UdpHost, UdpSocket};
pub use self::relay::Relay;
pub use self::syslog::{SyslogHost, SyslogLink};
pub use self::update::{FirmwareState, NoUpdate, SharedUpdate, Update, UpdateError, Version};

/// Why something could not be opened, with a hint for the user.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OpenError {
    /// The class of the error, on which the core may act.
    pub kind: OpenErrorKind,
    /// A hint for the user ("add yourself to the group dialout"), or empty.
    pub hint: &'static str,
}

/// The classes of [`OpenError`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OpenErrorKind {
    /// No such device or address on this board.
    NotFound,
    /// The system forbids it.
    Denied,
    /// Another program has it open.
    InUse,
    /// The hardware does not support these settings.
    Unsupported,
    /// The peer refused the connection.
    Refused,
    /// The peer did not respond in time.
    TimedOut,
    /// The board has no socket left.
    Exhausted,
    /// Anything else.
    Failed,
}

impl OpenError {
    /// An error of `kind` with a `hint` for the user, which may be empty.
    pub const fn new(kind: OpenErrorKind, hint: &'static str) -> Self {
        Self { kind, hint }
    }
}

impl fmt::Display for OpenError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.kind {
            OpenErrorKind::NotFound => "not found",
            OpenErrorKind::Denied => "permission denied",
            OpenErrorKind::InUse => "in use by another program",
            OpenErrorKind::Unsupported => "settings not supported",
            OpenErrorKind::Refused => "connection refused",
            OpenErrorKind::TimedOut => "no response",
            OpenErrorKind::Exhausted => "no socket left",
            OpenErrorKind::Failed => "failed",
        })?;
        if self.hint.is_empty() { Ok(()) } else { write!(f, " ({})", self.hint) }
    }
}

/// Opens serial lines by the device name in a port's settings (`uart1`, `/dev/ttyUSB0`).
///
/// A line's `read` waits for at least one byte and returns what is available; `Ok(0)` or an error means that the line is lost (an
/// adapter was unplugged), and it is reopened with back-off. Dropping a pending `read` loses no byte. `write` accepts bytes for
/// transmission and may return before they have left; the core computes when they have. Dropping the line closes it.
pub trait SerialHost {
    /// An open line.
    type Line<'a>: SerialLine
    where
        Self: 'a;

    /// Opens `device` with the speed and character format of `line`.
    async fn open(&mut self, device: &str, line: &LineSettings) -> Result<Self::Line<'_>, OpenError>;

    /// How far reads may lag behind the wire, because of an operating system's scheduling or a USB adapter's buffer. A silence
    /// inside a frame counts only if it lasts that much longer.
    fn read_jitter(&self) -> Duration {
        Duration::from_ticks(0)
    }

    /// Whether characters written one at a time leave without gaps under any load: the board's transmitters are fed by interrupt or
    /// DMA, and its tasks wake in time. Cut-through is then on by default.
    fn never_underruns(&self) -> bool {
        false
    }
}

/// An open serial line.
pub trait SerialLine: Read + Write {
    /// Whether [`rest`](SerialLine::rest) is useful on this board.
    const RESTS: bool = false;

    /// Enables the transceiver's driver before a frame, and disables it when the last bit should have left; an implementation that
    /// knows that time more precisely waits for it. Called only if the settings leave the driver to the gateway
    /// ([`Driver::Rts`](crate::settings::Driver::Rts)); `open` rejects those settings if the board does not support it.
    async fn drive(&mut self, _on: bool) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Keeps the transceiver's driver on in pauses between writes, because a frame follows in pieces, or lets it go off behind what
    /// was written. For a board whose lines switch the driver by themselves.
    fn hold_driver(&mut self, _on: bool) {}

    /// Lets characters accumulate until `until`, none of which is needed earlier, instead of waking a sleeping program for each of
    /// them. Returns whether that time has passed; false if reading each character is preferable, or the time is too short.
    /// Dropping the pending future loses no character.
    async fn rest(&mut self, _until: Instant) -> bool {
        false
    }

    /// Lets the next [`read`](Read::read) return when so many characters are there, instead of with the first; 1 ends that. For boards
    /// that count characters in their interrupts. Returns whether this one does.
    fn gather(&mut self, _characters: usize) -> bool {
        false
    }

    /// Sends on this line what the open line `from` of this board receives, transformed by `relay`, without waking a task for each
    /// character. It starts with what `from` has received and `read` has not returned yet. Returns whether the board does it; in
    /// that case
    ///
    /// - it continues until the relay is over, or until `from` has been silent for a character at least, and at most for its t1.5
    ///   plus [the read jitter](SerialHost::read_jitter),
    /// - `from` returns what it received only afterwards, or when some characters are left, so that the tasks keep up at the frame's
    ///   end; until then [`is_relayed`](Self::is_relayed),
    /// - nothing else is written here before [`end_relay`](Self::end_relay).
    fn relay(&mut self, _from: &str, _relay: Relay) -> bool {
        false
    }

    /// Ends the [`relay`](Self::relay), if it is not over, and returns what was left of it.
    fn end_relay(&mut self) -> Option<Relay> {
        None
    }

    /// Whether another line is sending what this one receives, or has sent what `read` has not returned yet: the line is not silent
    /// then.
    fn is_relayed(&self) -> bool {
        false
    }

    /// How long the line had been silent when `read` returned the relayed characters; zero if it had not been.
    fn silence(&self) -> Duration {
        Duration::from_ticks(0)
    }

    /// Returns and clears the receive errors of the characters that `read` has returned or dropped; none on a line without error
    /// detection.
    fn take_flaws(&mut self) -> Flaws {
        Flaws::default()
    }
}

/// Receive errors of a serial line, in characters.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Flaws {
    /// Parity errors.
    pub parity: u32,
    /// Missing stop bits; a break counts as one.
    pub framing: u32,
    /// Overruns; the number of lost characters is unknown.
    pub overruns: u32,
}

/// Storage for the text of the settings. Replaced as a whole: after a power cut it has either the old or the new text.
pub trait Store {
    /// Reads up to `into.len()` bytes of the saved text from `offset`; 0 at its end or when nothing is saved.
    async fn read(&mut self, offset: usize, into: &mut [u8]) -> Result<usize, StoreError>;

    /// Appends `text` to the new version; the first call starts one.
    async fn append(&mut self, text: &[u8]) -> Result<(), StoreError>;

    /// Replaces the saved text by the new version, atomically.
    async fn commit(&mut self) -> Result<(), StoreError>;

    /// Confirms that the gateway has applied the text read last: later changes by others must not be overwritten.
    fn taken_over(&mut self) {}

    /// Sets whether the next version replaces the stored text even if others have changed it.
    fn overwrite(&mut self, _whatever: bool) {}

    /// Sets the author of the next version; `when` tells the time, in microseconds since 1970 began, UTC, if it is known.
    fn sign(&mut self, _who: &dyn fmt::Display, _when: impl FnOnce() -> Option<u64>) {}

    /// Writes what is known of the `nth` of the versions that were saved, from 0, the last one: when, how many lines it added and took
    /// away, and who, with tabs between. `None` if no such one is kept.
    fn write_version(&mut self, _nth: usize, _out: &mut dyn fmt::Write) -> Option<fmt::Result> {
        None
    }

    /// [`read`](Store::read) of the `nth` of these versions.
    async fn read_version(
        &mut self,
        _nth: usize,
        _offset: usize,
        _into: &mut [u8],
    ) -> Result<usize, StoreError> {
        Ok(0)
    }
}

/// Why settings could not be read or written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum StoreError {
    /// This board, or this run, has no storage for settings.
    #[error("there is no place to save settings: {0}")]
    Absent(&'static str),
    /// The text does not fit.
    #[error("the settings do not fit: {0} bytes at most")]
    Full(usize),
    /// The stored text was changed by others.
    #[error("the file was edited since it was read: `load` applies it, `save force` overwrites it")]
    Edited,
    /// The stored text is corrupt.
    #[error("the saved settings are corrupt")]
    Corrupt,
    /// The medium failed.
    #[error("writing the settings failed")]
    Failed,
    /// The medium failed, with the reason.
    #[error("the settings cannot be read or saved: {0}")]
    Refused(&'static str),
}

/// The state of a board's own network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NetworkState {
    /// Whether the link is up.
    pub link: bool,
    /// The address in use, if any.
    pub address: Option<StaticAddress>,
    /// The Ethernet address.
    pub hardware: [u8; 6],
}

/// The board itself: its name, its network, and how to restart it.
pub trait System {
    /// The board's name, for `show version`.
    fn name(&self) -> &str;

    /// The state of the board's own network; `None` if an operating system manages it.
    fn network(&self) -> Option<NetworkState> {
        None
    }

    /// Writes the name of serial line `n` (from 0), as ports open it; `None` after the last one.
    fn write_serial_line(&self, _n: usize, _out: &mut dyn fmt::Write) -> Option<fmt::Result> {
        None
    }

    /// Writes line `n` (from 0, without line end) of the board's own report: the reset cause, and how its last run ended. `None`
    /// after the last line.
    fn write_event(&self, _n: usize, _out: &mut dyn fmt::Write) -> Option<fmt::Result> {
        None
    }

    /// Writes the date and time of `at`; `None` on boards without a calendar.
    fn write_date(&self, _at: Instant, _out: &mut dyn fmt::Write) -> Option<fmt::Result> {
        None
    }

    /// Writes the expiry date, subject, issuer and state of `certificate`, separated by tabs. `None` on boards without TLS.
    fn write_certificate(
        &self,
        _certificate: &Certificate,
        _out: &mut dyn fmt::Write,
    ) -> Option<fmt::Result> {
        None
    }

    /// How the running firmware was started; `None` without updates.
    fn firmware(&self) -> Option<FirmwareState> {
        None
    }

    /// Starts writing captured frames to a new `file`, instead of the previous one; `None` stops.
    fn capture(&self, _file: Option<&str>) -> Result<(), OpenError> {
        Err(OpenError::new(OpenErrorKind::Unsupported, "no files here: port NAME tcp server 5029 capture"))
    }

    /// Whether `password` matches `hash`. Takes as long without a hash, so that timing does not reveal which users exist.
    async fn is_password(&self, _hash: Option<&str>, _password: &str) -> bool
    where
        Self: Sized,
    {
        false
    }

    /// The hash of a new password, with a random salt; `None` on boards without users, or without random numbers.
    async fn hash_password(&self, _password: &str) -> Option<PasswordHash>
    where
        Self: Sized,
    {
        None
    }

    /// Fills `into` with unpredictable random numbers; returns whether the board can.
    fn random(&self, _into: &mut [u8]) -> bool
    where
        Self: Sized,
    {
        false
    }

    /// Restarts the gateway with the saved settings; may return before it happens.
    fn reboot(&self);
}
