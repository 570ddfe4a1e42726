//! The part of the image that each PDO carries, and the image size of the assigned PDOs.

use ethercat_subdevice::sync_manager::Channel;

/// Bytes of the input buffer and of the output buffer for a controller of 4 KiB.
pub(super) const IMAGE_BYTES: u16 = 512;

/// Bytes of the input buffer for a larger controller: one frame.
pub(super) const LONG_INPUTS: u16 = 1_486;

/// Bytes of the output buffer for a larger controller.
pub(super) const LONG_OUTPUTS: u16 = 1_500;

/// Bytes accessible one by one: those of the PDOs assigned after power-on.
pub(super) const FIRST_BYTES: u16 = 120;

/// End of the PDO that follows those, and start of the next.
pub(super) const SECOND_END: u16 = 256;

/// Bytes of an entry of a long image: complete registers, and at most 255 bits, the SII's limit.
pub(super) const LONG_ENTRY: u16 = 30;

/// End of a long image's PDO that follows the first bytes, and start of the next.
pub(super) const LONG_FIRST_END: u16 = 510;

/// End of that one, and start of the last one.
pub(super) const LONG_SECOND_END: u16 = 1_020;

/// Bytes available for images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Room {
    /// Of inputs.
    pub inputs: u16,
    /// Of outputs.
    pub outputs: u16,
}

impl Room {
    /// With all PDOs assigned.
    pub const MOST: Self = Self { inputs: IMAGE_BYTES, outputs: IMAGE_BYTES };
    /// With all PDOs of long images assigned.
    pub const LONG: Self = Self { inputs: LONG_INPUTS, outputs: LONG_OUTPUTS };
    /// With the PDOs assigned after power-on.
    pub const FIRST: Self = Self { inputs: FIRST_BYTES, outputs: FIRST_BYTES };

    /// With `pdos` assigned to the SyncManager `channel`, and the others unchanged.
    pub(super) fn with(self, channel: Channel, pdos: &[u16]) -> Self {
        match channel {
            Channel::Outputs => Self { outputs: covered(pdos), ..self },
            Channel::Inputs => Self { inputs: covered(pdos), ..self },
            Channel::MailboxOut | Channel::MailboxIn => self,
        }
    }
}

/// The bytes of its buffer that a PDO carries, as start and end; `None` for PDOs without a buffer.
pub(super) const fn span(pdo: u16) -> Option<(u16, u16)> {
    match pdo {
        0x1600 | 0x1601 | 0x1a00 | 0x1a01 => Some((0, FIRST_BYTES)),
        0x1602 | 0x1a04 => Some((FIRST_BYTES, SECOND_END)),
        0x1603 | 0x1a05 => Some((SECOND_END, IMAGE_BYTES)),
        0x1604 | 0x1a07 => Some((FIRST_BYTES, LONG_FIRST_END)),
        0x1605 | 0x1a08 => Some((LONG_FIRST_END, LONG_SECOND_END)),
        0x1606 => Some((LONG_SECOND_END, LONG_OUTPUTS)),
        0x1a09 => Some((LONG_SECOND_END, LONG_INPUTS)),
        _ => None,
    }
}

/// Start of the input bytes behind the last complete entry of a long image.
pub(super) const LONG_LAST_INPUTS: u16 = LONG_INPUTS / LONG_ENTRY * LONG_ENTRY;

/// Contiguous bytes from the start that `pdos` cover.
fn covered(pdos: &[u16]) -> u16 {
    let mut end = 0;
    // Terminates: each PDO continues another one.
    while let Some((_, next)) = pdos.iter().filter_map(|pdo| span(*pdo)).find(|(first, _)| *first == end) {
        end = next;
    }
    end
}

#[cfg(test)]
mod tests {
    use super::covered;

    #[test]
    fn what_pdos_carry_counts_up_to_the_first_gap() {
        assert_eq!(covered(&[]), 0);
        assert_eq!(covered(&[0x1a00, 0x1a02]), 120);
        assert_eq!(covered(&[0x1601, 0x1602]), 256);
        assert_eq!(covered(&[0x1603, 0x1600, 0x1602]), 512, "in any order");
        assert_eq!(covered(&[0x1600, 0x1603]), 120);
        assert_eq!(covered(&[0x1601, 0x1604, 0x1605, 0x1606]), 1_500);
        assert_eq!(covered(&[0x1a01, 0x1a07, 0x1a08, 0x1a09, 0x1a06]), 1_486);
        assert_eq!(covered(&[0x1a04, 0x1a05]), 0, "without the first ones the others are no image");
    }
}
