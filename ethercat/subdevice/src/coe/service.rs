//! A message's service, by its number in the header.

use crate::mailbox::Payload;

/// The service of a message, in bits 15:12 of the header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Service {
    Emergency = 1,
    SdoRequest = 2,
    SdoResponse = 3,
    SdoInformation = 8,
}

impl Service {
    /// Builds a message of this service.
    pub(super) fn message(self, parts: &[&[u8]]) -> Payload {
        let mut payload = Payload::new();
        let header = u16::from(self as u8) << 12;
        // Callers limit their data to the mailbox's size, which never exceeds the payload's capacity.
        let mut kept = payload.extend_from_slice(&header.to_le_bytes());
        for part in parts {
            kept = kept.and_then(|()| payload.extend_from_slice(part));
        }
        debug_assert!(kept.is_ok(), "a message is cut to the mailbox's size");
        payload
    }
}
