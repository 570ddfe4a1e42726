//! Substitute values for the inputs of a device that does not respond.

use super::Scanner;
use super::bits::copy_bits;
use super::row::DeviceId;

/// Eight set bits.
const ONES: [u8; 1] = [0xff];

impl Scanner {
    /// Fills the inputs of `device`, if it is configured to.
    pub(super) fn fill(&mut self, device: DeviceId) {
        let Some(value) = self.station(device).and_then(|station| station.device.filling) else { return };
        for entry in self.entries.iter().filter(|entry| entry.row.device == Some(device)) {
            let row = &entry.row;
            let cells = self.values.span_mut(row.input, row.kind.bytes(row.count));
            if !row.kind.is_bits() {
                cells.as_chunks_mut().0.fill(value.to_be_bytes());
                continue;
            }
            cells.fill(0);
            if value & 1 == 1 {
                // Unused bits stay 0.
                (0..usize::from(row.count)).for_each(|at| copy_bits(&ONES, 0, cells, at, 1));
            }
        }
    }
}
