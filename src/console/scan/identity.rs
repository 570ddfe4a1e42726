//! A unit's identification: the basic objects (FC 2Bh/0Eh), or its server id (FC 11h).

use core::fmt::{self, Write};

use crate::modbus::pdu::function::{ENCAPSULATED_INTERFACE, MEI_DEVICE_IDENTIFICATION, REPORT_SERVER_ID};

/// Fewer letters and digits do not count as text.
const TEXT_CHARS_MIN: usize = 1;

/// A response's PDU as text, with dots for unprintable characters; nothing if it is not an identification.
pub(super) struct Identity<'p>(pub(super) &'p [u8]);

impl fmt::Display for Identity<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            // Access type, conformity level, more follows, next object, number of objects (6.21).
            [ENCAPSULATED_INTERFACE, MEI_DEVICE_IDENTIFICATION, _, _, _, _, _, objects @ ..] => {
                let mut rest = objects;
                while let [_, length, behind @ ..] = rest {
                    let (object, others) =
                        behind.split_at_checked(usize::from(*length)).unwrap_or((behind, &[]));
                    text(object, f)?;
                    rest = others;
                }
                Ok(())
            }
            [REPORT_SERVER_ID, _, id @ ..] => text(id, f),
            _ => Ok(()),
        }
    }
}

/// Leaves out binary data.
fn text(bytes: &[u8], f: &mut fmt::Formatter<'_>) -> fmt::Result {
    if bytes.iter().filter(|byte| byte.is_ascii_alphanumeric()).count() < TEXT_CHARS_MIN {
        return Ok(());
    }
    let shown = |byte: &u8| if byte.is_ascii_graphic() || *byte == b' ' { char::from(*byte) } else { '.' };
    f.write_char(' ')?;
    bytes.iter().try_for_each(|byte| f.write_char(shown(byte)))
}
