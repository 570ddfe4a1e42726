//! The scanner's rows for the process image.

use embassy_time::Instant;

use super::layout::DeviceLayout;
use crate::scanner::{Device, Full, Reading, Row, Scanner, Writing};
use crate::settings::{Cells, SlaveSettings};

/// Start of the input buffer in the scanner's memory; the output buffer follows.
pub(super) const INPUTS: u16 = 0;

/// Adds rows to `scanner` that read `slave` into its part of the input buffer, and write from its part of the output buffer, which
/// starts at `outputs`.
pub(super) fn add(
    scanner: &mut Scanner,
    slave: &SlaveSettings,
    layout: &DeviceLayout,
    outputs: u16,
    now: Instant,
) -> Result<(), Full> {
    let device =
        Device { unit: slave.unit, order: slave.order, check: slave.check, filling: slave.filling() };
    let id = scanner.add_device(device)?;
    for (kind, Cells { count, address }) in slave.tables().filter(|(_, cells)| cells.count > 0) {
        let input = INPUTS + layout.input(kind);
        let output = layout.output(kind);
        let range = Row {
            device: Some(id),
            kind,
            first: address,
            count,
            input,
            output: output.map_or(input, |output| outputs + output),
            read: Reading::Every(slave.polling_ms),
            write: if output.is_some() { Writing::OnChange } else { Writing::Never },
            multiple: false,
            form: slave.form(kind),
            of: None,
            quality: None,
        };
        scanner.add_range(range, now)?;
    }
    Ok(())
}
