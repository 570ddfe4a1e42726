//! Topics of audit lines, and the actors that cause them.

use core::fmt;
use core::net::IpAddr;

use strum::{IntoStaticStr, VariantArray};

use crate::settings::{Address, PortId};

/// What a line is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, VariantArray, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum Topic {
    /// The gateway starts or stops, with the reason.
    Start,
    /// The settings have changed.
    Settings,
    /// The settings were saved.
    Save,
    /// A command that changes something else, such as a write to a device.
    Command,
    /// A user logged in, or a console was opened or closed.
    LogIn,
    /// New firmware.
    Update,
    /// A name or a password was wrong.
    LogInFailed,
    /// A peer may not connect, or there was no room.
    RefusedClient,
    /// A rule forbids a write.
    DeniedWrite,
    /// A role forbids a command.
    DeniedCommand,
    /// A connection was closed to make room for another.
    Displaced,
    /// A unit went down or recovered.
    Unit,
}

impl Topic {
    /// Its name, which is also the MSGID in syslog.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The topic with this number.
    pub(super) fn of(number: u8) -> Option<Self> {
        Self::VARIANTS.get(usize::from(number)).copied()
    }

    /// Whether unauthenticated peers can cause it without limit.
    pub fn is_refusal(self) -> bool {
        self as u8 >= Self::LogInFailed as u8
    }

    /// Events per interval that get their own line; the others are counted.
    pub(super) const fn told_max(self) -> u32 {
        match self {
            Self::DeniedWrite => 1,
            Self::Unit => 16,
            _ => 4,
        }
    }

    /// Several of them.
    pub(super) const fn plural(self) -> &'static str {
        match self {
            Self::LogInFailed => "failed log-ins",
            Self::RefusedClient => "refused clients",
            Self::DeniedWrite => "denied writes",
            Self::DeniedCommand => "denied commands",
            Self::Displaced => "displaced connections",
            Self::Unit => "units down or up",
            _ => "events",
        }
    }
}

/// How a session has come in.
#[cfg_attr(not(feature = "candidate"), allow(dead_code))] // What asks is left out.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Way {
    /// Its port, if that is one of the settings.
    pub(crate) port: Option<PortId>,
    /// By the name of mDNS.
    pub(crate) by_name: bool,
}

/// Who is behind a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Actor<'a> {
    /// The gateway itself.
    Gateway,
    /// The local console.
    Local,
    /// A user who has logged in.
    User {
        /// The name.
        name: &'a str,
        /// The address.
        peer: IpAddr,
    },
    /// Somebody at this address.
    Peer(IpAddr),
    /// The EtherCAT MainDevice.
    Ethercat,
    /// The operating system's side: starts, stops, and edits of the file.
    System,
}

impl fmt::Display for Actor<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Gateway => f.write_str("gateway"),
            Self::Local => f.write_str("local console"),
            Self::User { name, peer } => write!(f, "{name}@{}", Address(*peer)),
            Self::Peer(peer) => Address(*peer).fmt(f),
            Self::Ethercat => f.write_str("EtherCAT"),
            Self::System => f.write_str("system"),
        }
    }
}
