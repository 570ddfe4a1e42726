//! What a board must give: serial lines, TCP sockets, a place for settings, facts about itself.
//!
//! A board implements these traits over its hardware; the core's port tasks own the implementors and open what
//! the settings name. Everything is polled from one executor, so no trait asks for `Send`.

use core::fmt;
use core::net::SocketAddr;

use embassy_time::{Duration, Instant};
use embedded_io_async::{Read, Write};

use crate::settings::{LineSettings, ServerAddress, StaticAddress, TcpListen};

mod relay;

pub use self::relay::Relay;

/// Why something could not be opened, with what the user can do about it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OpenError {
    /// What went wrong, in the class that the core may act on.
    pub kind: OpenErrorKind,
    /// A sentence for the user ("add yourself to the group dialout"); empty when there is nothing to add.
    pub hint: &'static str,
}

/// The classes of [`OpenError`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OpenErrorKind {
    /// No such device or address on this board.
    NotFound,
    /// The system forbids it.
    Denied,
    /// Somebody else has it open.
    InUse,
    /// The hardware cannot do these settings.
    Unsupported,
    /// The other side refused the connection.
    Refused,
    /// The other side did not answer in time.
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
            OpenErrorKind::TimedOut => "no answer",
            OpenErrorKind::Exhausted => "no socket left",
            OpenErrorKind::Failed => "failed",
        })?;
        if self.hint.is_empty() { Ok(()) } else { write!(f, " ({})", self.hint) }
    }
}

/// Opens serial lines by the name that stands in a port's settings (`uart1`, `/dev/ttyUSB0`).
///
/// A line's `read` waits for at least one byte and returns what is there; `Ok(0)` or an error means that the
/// line is gone (an adapter was unplugged) and is opened again with back-off. Dropping a pending `read` loses
/// no byte. `write` takes bytes for transmission and may return before they have left; the core computes when
/// they have. Dropping the line closes it.
pub trait SerialHost {
    /// An open line.
    type Line<'a>: SerialLine
    where
        Self: 'a;

    /// Opens `device` with `line`'s speed and character format.
    async fn open(&mut self, device: &str, line: &LineSettings) -> Result<Self::Line<'_>, OpenError>;

    /// How much later than on the wire bytes may be read: an operating system's scheduling, a USB adapter's buffer.
    /// Silence inside a frame is believed only when it lasts that much longer.
    fn read_jitter(&self) -> Duration {
        Duration::from_ticks(0)
    }

    /// Whether what is written a character at a time leaves without gaps, however busy the board is: its transmitters are
    /// fed by interrupt or DMA, and its tasks wake in time. Then frames are passed on while they arrive, unless a rule
    /// says otherwise.
    fn never_underruns(&self) -> bool {
        false
    }
}

/// An open serial line.
pub trait SerialLine: Read + Write {
    /// Whether [`rest`](SerialLine::rest) is ever worth its while here.
    const RESTS: bool = false;

    /// Switches the transceiver's driver on before a frame, and off when its last bit should have left; a line that knows
    /// better when that is waits for it. Called only where the settings leave the driver to the gateway
    /// ([`Driver::Rts`](crate::settings::Driver::Rts)); `open` refuses those settings where it cannot be done.
    async fn drive(&mut self, _on: bool) -> Result<(), Self::Error> {
        Ok(())
    }

    /// None of the characters that come before `until` is needed earlier: where each of them would wake a sleeping program,
    /// that time passes here without a look at the line, and they are read afterwards, all at once. Says whether it has; it has
    /// not where characters are best read as they come, or that time is too short. Dropping the pending future loses none.
    async fn rest(&mut self, _until: Instant) -> bool {
        false
    }

    /// Lets what the open line `from` of this board hears be sent here, as `relay` makes it, without a task that wakes for each
    /// character. It begins with what that line has heard and `read` has not given yet. Says whether the board does that; then
    ///
    /// - it does so until the relay is over, or `from` has been silent for longer than its t1.5, by as much as
    ///   [reads may be late](SerialHost::read_jitter),
    /// - `from` gives what it heard meanwhile afterwards, all at once, and [`is_relayed`](Self::is_relayed) until then,
    /// - nothing else is written here before [`end_relay`](Self::end_relay).
    fn relay(&mut self, _from: &str, _relay: Relay) -> bool {
        false
    }

    /// Ends what [`relay`](Self::relay) began, if it is not over, and gives what is left of it.
    fn end_relay(&mut self) -> Option<Relay> {
        None
    }

    /// Whether another line is sending what this one hears, or has sent what `read` has not given yet: that is no silence.
    fn is_relayed(&self) -> bool {
        false
    }

    /// For how long the line had been silent when `read` gave what was relayed until then; nothing where it was not.
    fn silence(&self) -> Duration {
        Duration::from_ticks(0)
    }

    /// The characters that the receiver found faulty since it was asked last, of those that `read` has given or dropped. A
    /// line whose receiver does not tell has none.
    fn take_flaws(&mut self) -> Flaws {
        Flaws::default()
    }
}

/// Characters that a serial line's receiver found faulty.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Flaws {
    /// With a wrong parity bit.
    pub parity: u32,
    /// Without their stop bit; a break counts as one.
    pub framing: u32,
    /// Come too early for those before them to have been taken; how many were lost nobody knows.
    pub overruns: u32,
}

/// Accepts TCP connections, one at a time; every connection task owns one.
///
/// Several hosts may be told to accept at the same address at once: they share the listening socket.
pub trait TcpHost {
    /// An accepted connection, Nagle off, keepalive and user time-out set.
    type Stream<'a>: TcpStream
    where
        Self: 'a;

    /// Opens the listening socket at `listen`, if this board has such and it is not open yet, so that a fault shows
    /// before the first client comes.
    fn listen(&mut self, listen: &TcpListen) -> Result<(), OpenError>;

    /// Waits for the next connection at `listen` and gives it with the peer's address. Dropping the pending
    /// future loses no connection.
    async fn accept(&mut self, listen: &TcpListen) -> Result<(Self::Stream<'_>, SocketAddr), OpenError>;
}

/// Makes TCP connections to outside servers, several at a time; every port task has one.
pub trait TcpConnect {
    /// A connection, Nagle off, keepalive and user time-out set.
    type Stream<'a>: TcpStream
    where
        Self: 'a;

    /// Connects to `server`, whose name is looked up if it has one; [`OpenErrorKind::Exhausted`] when all of the board's sockets
    /// are in use. The caller limits the time: dropping the pending future gives up.
    async fn connect(&self, server: &ServerAddress) -> Result<Self::Stream<'_>, OpenError>;
}

/// A TCP connection. `read` gives `Ok(0)` at the peer's FIN; dropping a pending `read` loses no byte.
pub trait TcpStream: Read + Write {
    /// Ends the connection in an orderly way, within a bounded time.
    async fn close(self);
}

/// Opens UDP sockets; every port task owns one.
pub trait UdpHost {
    /// An open socket.
    type Socket<'a>: UdpSocket
    where
        Self: 'a;

    /// Opens a socket at `listen`'s address and UDP port.
    async fn bind(&mut self, listen: &TcpListen) -> Result<Self::Socket<'_>, OpenError>;
}

/// A UDP socket. Datagrams may be lost, doubled or overtake each other; dropping a pending `receive` loses none.
pub trait UdpSocket {
    /// Waits for a datagram, and gives its length and who sent it. One that is longer than `into` is cut off there.
    async fn receive(&mut self, into: &mut [u8]) -> Result<(usize, SocketAddr), SocketLost>;

    /// Sends a datagram. That nobody is there to receive it is no error.
    async fn send(&mut self, datagram: &[u8], to: SocketAddr) -> Result<(), SocketLost>;
}

/// A socket that cannot be used any more, and must be opened again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SocketLost;

/// Where the settings' text is kept. Replaced as a whole, so that a power cut leaves the old or the new text.
pub trait Store {
    /// Reads up to `into.len()` bytes of the saved text from `offset` on; 0 at its end or when nothing is saved.
    async fn read(&mut self, offset: usize, into: &mut [u8]) -> Result<usize, StoreError>;

    /// Appends `text` to the new version that is being written; the first call starts one.
    async fn append(&mut self, text: &[u8]) -> Result<(), StoreError>;

    /// Makes the appended text the saved one, at once and whole.
    async fn commit(&mut self) -> Result<(), StoreError>;

    /// The gateway has taken over what was read last. What somebody else writes from now on is not to be lost.
    fn taken_over(&mut self) {}

    /// Whether the next version replaces what is there even if somebody else has written it.
    fn overwrite(&mut self, _whatever: bool) {}
}

/// Why settings could not be read or written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum StoreError {
    /// This board or this run has no place for settings.
    #[error("there is no place to save settings: {0}")]
    Absent(&'static str),
    /// The text does not fit.
    #[error("the settings do not fit: {0} bytes at most")]
    Full(usize),
    /// Somebody else has written what is stored.
    #[error("the file was edited since it was read: `load` takes it over, `save force` writes over it")]
    Edited,
    /// What is stored is not what was written.
    #[error("the saved settings are damaged")]
    Damaged,
    /// The medium refused.
    #[error("writing the settings failed")]
    Failed,
    /// The medium refused, and says why.
    #[error("the settings file cannot be read or written: {0}")]
    Refused(&'static str),
}

/// How a board's own network does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NetworkState {
    /// Whether the cable is in.
    pub link: bool,
    /// The address in use, if there is one yet.
    pub address: Option<StaticAddress>,
    /// The Ethernet address.
    pub hardware: [u8; 6],
}

/// The board itself: its name, its serial lines' names, and how to start it again.
pub trait System {
    /// The board's name, for `show version`.
    fn name(&self) -> &str;

    /// How the board's own network does; `None` where an operating system has it.
    fn network(&self) -> Option<NetworkState> {
        None
    }

    /// Writes what the board itself has to report, line `n` (from 0) without its line end: why it started, what its last run
    /// died of. `None` behind the last line.
    fn write_event(&self, _n: usize, _out: &mut dyn fmt::Write) -> Option<fmt::Result> {
        None
    }

    /// Writes frames into a new `file` from now on, in place of the one before; `None`: no more.
    fn capture(&self, _file: Option<&str>) -> Result<(), OpenError> {
        Err(OpenError::new(OpenErrorKind::Unsupported, "no files here: port NAME tcp server 5029 capture"))
    }

    /// Starts the gateway again with the saved settings; may return when that takes a moment.
    fn reboot(&self);
}
