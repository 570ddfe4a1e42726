//! What settings can hold: how many of a thing, and how long its name is.

use heapless::String;

/// Ports that settings can hold. With the feature `small`: as many as small boards run.
pub const PORTS_MAX: usize = if cfg!(feature = "small") { 8 } else { 16 };

/// Routing rules that settings can hold.
pub const ROUTES_MAX: usize = 64;

/// Longest port name in bytes.
pub const NAME_BYTES_MAX: usize = 15;

/// Longest device name in bytes: with the feature `paths` that of a file, since names under `/dev/serial/by-id` have more than
/// 100. Boards name UARTs.
pub const DEVICE_BYTES_MAX: usize = if PATHS { 255 } else { 15 };

const PATHS: bool = cfg!(feature = "paths");

/// Address prefixes in one list of a TCP server.
pub const RESERVED_MAX: usize = 4;

/// Longest line of the line language in bytes. Settings at their limits print shorter ones: what is printed can be read.
pub const LINE_BYTES_MAX: usize = if PATHS { 800 } else { 640 };

/// A port's name, as rules call it.
pub type Name = String<NAME_BYTES_MAX>;

/// A port's place in the settings, stable while the port exists.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PortId(pub u8);

impl PortId {
    /// The place as an index.
    pub const fn index(self) -> usize {
        self.0 as usize
    }
}
