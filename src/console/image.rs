//! `show image`: the values of the devices in the EtherCAT process image, by what they are at the device.

use core::fmt;

use super::layout::Columns;
use super::output::Written;
use super::rows::LINE_VALUES_MAX;
use super::table::Source;
use super::values::Values;
use crate::scanner::{Kind, Scale};
use crate::settings::{Cells, SlaveSettings};

pub(super) const HEAD: &str = "NO\tUNIT\tIMAGE\tTABLE\tADDRESS\tVALUES";
/// The widths of the columns.
pub(super) const COLUMNS: Columns = &[-3, -4, 7, 8, -7];

/// Some values of a table of a slave.
struct Part<'s> {
    slave: (usize, &'s SlaveSettings),
    /// Those that the MainDevice writes.
    outputs: bool,
    kind: Kind,
    cells: Cells,
    /// The first of them.
    first: u16,
}

/// The parts of a slave's tables in one of the images.
fn parts(slave: (usize, &SlaveSettings), outputs: bool) -> impl Iterator<Item = Part<'_>> {
    let tables = slave.1.tables().filter(move |(kind, _)| !outputs || kind.is_writable());
    tables.flat_map(move |(kind, cells)| {
        let values = cells.count / slave.1.value_type(kind).registers();
        (0..values).step_by(LINE_VALUES_MAX).map(move |first| Part { slave, outputs, kind, cells, first })
    })
}

/// Row `nth`: at most eight values.
pub(super) fn row(source: &Source<'_, '_>, nth: usize, out: &mut dyn fmt::Write) -> Written {
    let Source { gateway, settings, .. } = *source;
    let state = gateway.ethercat().filter(|state| state.is_running())?;
    let slaves = settings.slaves.iter().enumerate();
    let mut rows =
        slaves.flat_map(|slave| [false, true].into_iter().flat_map(move |outputs| parts(slave, outputs)));
    let Part { slave: (no, slave), outputs, kind, cells, first } = rows.nth(nth)?;
    let layout = state.layout(no);
    let (value, start) =
        (slave.value_type(kind), if outputs { layout.output(kind)? } else { layout.input(kind) });
    let values = cells.count / value.registers();
    let (image, address) =
        (if outputs { "outputs" } else { "inputs" }, cells.address.wrapping_add(first * value.registers()));
    let range = first.into()..usize::from(values).min(usize::from(first) + LINE_VALUES_MAX);
    let write = |bytes: &[u8]| {
        let cells = bytes.get(start.into()..).unwrap_or_default();
        write!(
            out,
            "{no}\t{}\t{image}\t{kind}\t{address}\t{}",
            slave.unit,
            Values { value, scale: Scale::NONE, cells, range }
        )
    };
    Some(if outputs { state.outputs(write) } else { state.inputs(write) })
}
