//! The console by SSH, for boards: a server without allocation, for one session at a time on any stream.
//!
//! The path of a session: [`serve`] gets a connection. Both sides identify themselves and exchange keys (`link`, `exchange`); the gateway
//! decides about the log-in (`log_in`); the client opens a channel and asks for a shell, or for a line to be run (`channel`). From then
//! on two futures share a `terminal`: the console, and the one that carries its bytes to the client and back. At the end the client
//! gets the exit status.
//!
//! There is one algorithm of each kind: `curve25519-sha256`, `ssh-ed25519`, `chacha20-poly1305@openssh.com`. Nothing but sessions is
//! served: no forwarding, no agent, no subsystem. What a client sends is checked before it is used, and what is wrong ends the
//! connection; nothing here panics.
#![no_std]
#![forbid(unsafe_code)]
#![deny(clippy::unwrap_used, clippy::indexing_slicing)]

mod channel;
mod cipher;
mod exchange;
mod link;
mod log_in;
mod packets;
mod session;
mod terminal;
mod wire;

pub use session::{Board, Visit, serve};

/// Bytes of the seed that a host key is made of.
pub const SEED_BYTES: usize = 32;

/// Why a connection has ended early.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Error {
    /// The client has gone.
    Closed,
    /// The server has ended it, for this reason (RFC 4253, 11.1).
    Refused(u32),
}

impl Error {
    pub(crate) const MALFORMED: Self = Self::Refused(2);
    pub(crate) const NO_COMMON_ALGORITHM: Self = Self::Refused(3);
    pub(crate) const NO_SUCH_SERVICE: Self = Self::Refused(7);
    pub(crate) const NO_RANDOM_NUMBERS: Self = Self::Refused(11);
    pub(crate) const TOO_LATE: Self = Self::Refused(11);
    pub(crate) const TOO_MANY_ATTEMPTS: Self = Self::Refused(14);
}
