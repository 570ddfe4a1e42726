//! Which bytes of the buffers each PDO carries, and so how long an image the assigned ones hold.

use ethercat_subdevice::sync_manager::Channel;

/// Bytes of the input buffer and of the output buffer.
pub(super) const IMAGE_BYTES: u16 = 512;
/// Bytes that can be had one by one: those of the PDOs that are assigned after power-on.
pub(super) const FIRST_BYTES: u16 = 120;
/// Where the second of the PDOs behind those ends, and the third begins.
pub(super) const SECOND_END: u16 = 256;

/// Bytes that there are for images.
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
    /// With the PDOs of after power-on.
    pub const FIRST: Self = Self { inputs: FIRST_BYTES, outputs: FIRST_BYTES };

    /// With `pdos` assigned to the SyncManager `channel`, and the others as they are.
    pub(super) fn with(self, channel: Channel, pdos: &[u16]) -> Self {
        match channel {
            Channel::Outputs => Self { outputs: covered(pdos), ..self },
            Channel::Inputs => Self { inputs: covered(pdos), ..self },
            Channel::MailboxOut | Channel::MailboxIn => self,
        }
    }
}

/// The bytes of its buffer that a PDO carries, as the first one and the one behind them; none for one of another purpose.
pub(super) const fn span(pdo: u16) -> Option<(u16, u16)> {
    match pdo {
        0x1600 | 0x1601 | 0x1a00 | 0x1a01 => Some((0, FIRST_BYTES)),
        0x1602 | 0x1a04 => Some((FIRST_BYTES, SECOND_END)),
        0x1603 | 0x1a05 => Some((SECOND_END, IMAGE_BYTES)),
        _ => None,
    }
}

/// Bytes from the first one on that `pdos` carry without a gap.
fn covered(pdos: &[u16]) -> u16 {
    let mut end = 0;
    // Each goes on behind another one: there is no loop.
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
        assert_eq!(covered(&[0x1a04, 0x1a05]), 0, "without the first ones the others are no image");
    }
}
