//! Capacities of the settings: numbers of items, and lengths of names.

use heapless::String;

/// Ports in the settings; with the feature `small`, as many as small boards run.
pub const PORTS_MAX: usize = if cfg!(feature = "small") { 8 } else { 16 };

/// Routing rules in the settings.
pub const ROUTES_MAX: usize = 64;

/// Longest port name in bytes.
pub const NAME_BYTES_MAX: usize = 15;

/// Longest device name in bytes: with the feature `paths` that of a file, since names under `/dev/serial/by-id` exceed 100 bytes.
/// Boards have short UART names.
pub(crate) const DEVICE_BYTES_MAX: usize = if PATHS { 255 } else { 15 };

pub(crate) const PATHS: bool = cfg!(feature = "paths");

/// Address prefixes in one list.
pub(crate) const RESERVED_MAX: usize = 4;

/// Longest line of the configuration language in bytes. Printed lines are shorter, so they can be read back.
pub const LINE_BYTES_MAX: usize = if PATHS { 800 } else { 640 };

/// A port's name.
pub type Name = String<NAME_BYTES_MAX>;

/// A port's index in the settings, stable while the port exists.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PortId(pub u8);

impl PortId {
    /// The index.
    pub const fn index(self) -> usize {
        self.0 as usize
    }
}
