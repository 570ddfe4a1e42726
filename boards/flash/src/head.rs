//! The head: one small map item that says where the text is that is valid.

use crc::{CRC_32_ISO_HDLC, Crc, NoTable};

/// CRC over the whole text. Without a table, which takes 1 KiB: it is computed only at start-up and when saving.
pub(crate) static CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// Format version. A head with another version is left alone and reported.
const VERSION: u8 = 1;
pub(crate) const HEAD_BYTES: usize = 10;

/// Where a text is, its length and its checksum.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Head {
    /// The place of its first piece: in bit 0 the half of the ring, above it the number in that half. In firmware with two copies it is
    /// 0 or 1.
    pub(crate) first: u8,
    pub(crate) length: u32,
    pub(crate) crc: u32,
}

impl Head {
    pub(crate) fn to_bytes(self) -> [u8; HEAD_BYTES] {
        let [l0, l1, l2, l3] = self.length.to_le_bytes();
        let [c0, c1, c2, c3] = self.crc.to_le_bytes();
        [VERSION, self.first, l0, l1, l2, l3, c0, c1, c2, c3]
    }

    /// `None` if another firmware version wrote it.
    pub(crate) fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let &[VERSION, first, l0, l1, l2, l3, c0, c1, c2, c3] = bytes else { return None };
        let (length, crc) = (u32::from_le_bytes([l0, l1, l2, l3]), u32::from_le_bytes([c0, c1, c2, c3]));
        Some(Self { first, length, crc })
    }
}

/// The head of the settings that were saved while an image was on trial: a [`Head`], and the image's id.
pub(crate) const TRIAL_BYTES: usize = HEAD_BYTES + size_of::<u32>();

/// A trial's head with the id of its image. An item of no bytes is none.
pub(crate) fn trial_to_bytes(head: Head, image: u32) -> [u8; TRIAL_BYTES] {
    let mut bytes = [0; TRIAL_BYTES];
    let all = head.to_bytes().into_iter().chain(image.to_le_bytes());
    bytes.iter_mut().zip(all).for_each(|(to, from)| *to = from);
    bytes
}

/// `None` if another firmware version wrote it, or there is none.
pub(crate) fn trial_from_bytes(bytes: &[u8]) -> Option<(Head, u32)> {
    let (head, &image) = bytes.split_last_chunk()?;
    Some((Head::from_bytes(head)?, u32::from_le_bytes(image)))
}

#[cfg(test)]
mod tests {
    use super::{Head, trial_from_bytes, trial_to_bytes};

    #[test]
    fn a_trials_head_reads_back() {
        let head = Head { first: 1, length: 0x1_0203, crc: 0xdead_beef };
        assert_eq!(trial_from_bytes(&trial_to_bytes(head, 7)), Some((head, 7)));
        assert_eq!(trial_from_bytes(&[]), None);
        assert_eq!(trial_from_bytes(&[0; 14]), None);
    }

    #[test]
    fn a_head_reads_back_and_another_versions_head_does_not() {
        let head = Head { first: 1, length: 0x1_0203, crc: 0xdead_beef };
        let mut bytes = head.to_bytes();
        assert_eq!(Head::from_bytes(&bytes), Some(head));
        bytes[0] += 1;
        assert_eq!(Head::from_bytes(&bytes), None);
        assert_eq!(Head::from_bytes(&[]), None);
    }
}
