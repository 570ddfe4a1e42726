//! The info block: what a firmware says of itself, at a fixed place, so that the signature covers it.

use crate::version::Version;

/// Where the block stands in a firmware: behind the longest vector table of the boards, that of the H743 with 664 bytes.
/// memory.x has the same number.
pub const INFO_OFFSET: usize = 0x400;
/// Bytes of the block.
pub const INFO_BYTES: usize = 32;
/// Longest name of a board, in bytes of ASCII.
pub const BOARD_BYTES_MAX: usize = 16;

/// What the block begins with: a name, and the number of this format.
const MAGIC: [u8; 8] = *b"MOBINFO\x01";

/// Board and version of a firmware, as the bytes of its info block: magic, name of the board filled up with zeros, version.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub struct Info {
    magic: [u8; 8],
    board: [u8; BOARD_BYTES_MAX],
    version: [u8; 8],
}

const _: () = assert!(size_of::<Info>() == INFO_BYTES && align_of::<Info>() == 1);

impl Info {
    /// The block of a firmware for `board` whose package has the version `version`; `None` if either does not fit: see
    /// [`BOARD_BYTES_MAX`] and [`Version::parse`]. Firmware uses [`info!`](crate::info!), which fails at build time instead.
    pub const fn new(board: &str, version: &str) -> Option<Self> {
        let Some(version) = Version::parse(version) else { return None };
        let mut padded = [0; BOARD_BYTES_MAX];
        let Some((to, _)) = padded.split_at_mut_checked(board.len()) else { return None };
        to.copy_from_slice(board.as_bytes());
        if !is_name(&padded) {
            return None;
        }
        Some(Self { magic: MAGIC, board: padded, version: version.to_bytes() })
    }

    /// The block that these bytes are; `None` if they are none, or one of another format.
    pub fn from_bytes(bytes: &[u8; INFO_BYTES]) -> Option<Self> {
        let (board, version) = bytes.strip_prefix(&MAGIC)?.split_first_chunk()?;
        let info = Self { magic: MAGIC, board: *board, version: *version.first_chunk()? };
        is_name(board).then_some(info)
    }

    /// The block of a firmware, from its bytes.
    pub fn of_firmware(firmware: &[u8]) -> Option<Self> {
        Self::from_bytes(firmware.get(INFO_OFFSET..)?.first_chunk()?)
    }

    /// The block as it stands in the firmware.
    pub fn to_bytes(&self) -> [u8; INFO_BYTES] {
        let mut bytes = [0; INFO_BYTES];
        let parts = self.magic.iter().chain(&self.board).chain(&self.version);
        bytes.iter_mut().zip(parts).for_each(|(byte, part)| *byte = *part);
        bytes
    }

    /// The board's name.
    pub fn board(&self) -> &str {
        let name = self.board.split(|byte| *byte == 0).next().unwrap_or_default();
        // The constructors let only ASCII in.
        core::str::from_utf8(name).unwrap_or_default()
    }

    /// The firmware's version.
    pub const fn version(&self) -> Version {
        Version::from_bytes(self.version)
    }
}

/// Whether this is a name of printable ASCII, with zeros behind it only.
const fn is_name(padded: &[u8; BOARD_BYTES_MAX]) -> bool {
    let mut rest: &[u8] = padded;
    while let [b' '..=b'~', after @ ..] = rest {
        rest = after;
    }
    if rest.len() == BOARD_BYTES_MAX {
        return false;
    }
    while let [0, after @ ..] = rest {
        rest = after;
    }
    rest.is_empty()
}

/// Makes the static `$name`, an [`Info`] of this firmware: for `$board`, with the version of the package that names it. The linker
/// puts it to [`INFO_OFFSET`]; there is one in a firmware.
#[macro_export]
macro_rules! info {
    ($name:ident, $board:expr) => {
        /// Board and version of this firmware, where updates look for them.
        // SAFETY: memory.x has a place of its own for the section and looks for the symbol; both are used here only.
        #[unsafe(link_section = ".mobgate_info")]
        #[unsafe(export_name = "MOBGATE_INFO")]
        #[used]
        static $name: $crate::Info = match $crate::Info::new($board, env!("CARGO_PKG_VERSION")) {
            Some(info) => info,
            None => panic!("the board's name or the package's version does not fit into the info block"),
        };
    };
}
