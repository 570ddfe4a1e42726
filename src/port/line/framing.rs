//! The differences between the two serial framings: frame encoding, and silences.

use embassy_time::Duration;

use crate::modbus::{PduLength, ascii, rtu};
use crate::settings::{Framing, LineSettings};

/// Longest frame of either framing, in characters.
pub(crate) const FRAME_CHARS_MAX: usize = ascii::FRAME_CHARS_MAX;
/// Longest silence between two characters of an ASCII frame (Serial Line 2.5.2.1).
const ASCII_SILENCE: Duration = Duration::from_secs(1);

impl Framing {
    /// Encodes a frame of `unit` and `pdu` into `out`, which has room for it; an ASCII frame ends with `delimiter`.
    pub(crate) fn encode<'a>(
        self,
        unit: u8,
        pdu: &[u8],
        delimiter: u8,
        out: &'a mut [u8],
    ) -> Result<&'a [u8], PduLength> {
        match self {
            Self::Rtu => rtu::encode(unit, pdu, out),
            Self::Ascii => ascii::encode(unit, pdu, out, delimiter),
        }
    }

    /// Characters of a frame whose PDU has this many bytes.
    pub(crate) const fn chars_of(self, pdu_bytes: usize) -> usize {
        match self {
            Self::Rtu => pdu_bytes + rtu::OVERHEAD_BYTES,
            // Unit, PDU and LRC take two digits per byte, after a colon and before the two end characters.
            Self::Ascii => 2 * (pdu_bytes + 2) + 3,
        }
    }

    /// Characters of the longest frame.
    pub(crate) const fn chars_max(self) -> usize {
        match self {
            Self::Rtu => rtu::FRAME_BYTES_MAX,
            Self::Ascii => ascii::FRAME_CHARS_MAX,
        }
    }

    /// The silence that ends an RTU frame and invalidates an ASCII one.
    pub(crate) fn silence(self, line: &LineSettings) -> Duration {
        line.char_timeout.unwrap_or_else(|| match self {
            Self::Rtu => line.gap(),
            Self::Ascii => ASCII_SILENCE,
        })
    }
}
