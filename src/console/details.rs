//! Tables that only the web interface uses, for its charts.

use core::fmt;

use super::output::{NO_ROW, Written};
use super::table::Source;
use crate::fieldbus::EthercatState;
use crate::gateway::unit_health::UNITS_MAX;
use crate::settings::{Cells, PortId};

pub(super) const UNITS: &str = "PORT\tUNIT\tTIMES\tERRORS";
pub(super) const ETHERCAT: &str = "CONTROLLER\tSTATE\tLINE";
pub(super) const MODULES: &str = "NO\tUNIT\tINPUTS\tOUTPUTS";

/// The counts of a unit's response times by class, and of its errors in the last hour: `silent 0 0 3 ..., bad-crc ...`.
pub(super) fn unit(source: &Source<'_, '_>, nth: usize, out: &mut dyn fmt::Write) -> Written {
    let Some((port, state)) = source.port(nth / UNITS_MAX)? else { return NO_ROW };
    let id = PortId((nth / UNITS_MAX) as u8);
    let Some(unit) = state.units(|units| units.iter().nth(nth % UNITS_MAX).copied()) else { return NO_ROW };
    Some((|| {
        write!(out, "{}\t{}\t", port.name, unit.id)?;
        for (class, count) in unit.times.classes().iter().enumerate() {
            write!(out, "{}{count}", if class > 0 { " " } else { "" })?;
        }
        out.write_str("\t")?;
        let mut comma = "";
        for (error, _) in unit.errors() {
            let counts = source.gateway.web.hour.errors(id, &unit, error);
            if counts.iter().all(|count| *count == 0) {
                continue;
            }
            write!(out, "{comma}{}", error.name())?;
            counts.iter().try_for_each(|count| write!(out, " {count}"))?;
            comma = ", ";
        }
        Ok(())
    })())
}

/// The controller, the state of the device, and the source of its line settings.
pub(super) fn ethercat(source: &Source<'_, '_>, nth: usize, out: &mut dyn fmt::Write) -> Written {
    let Source { gateway, settings, .. } = *source;
    let controller = gateway.ethercat_controller(settings).filter(|_| nth == 0)?;
    let state = gateway.ethercat().and_then(EthercatState::indicators);
    Some((|| {
        write!(out, "{controller}\t")?;
        state.map_or(Ok(()), |state| write!(out, "{state}"))?;
        let writer = gateway.ethercat().map(EthercatState::line_writer);
        writer.map_or(Ok(()), |writer| write!(out, "\t{writer}"))
    })())
}

/// A device in the process image: its values, and where they begin in the buffers of the image, in registers.
pub(super) fn module(source: &Source<'_, '_>, nth: usize, out: &mut dyn fmt::Write) -> Written {
    let Source { gateway, settings, .. } = *source;
    let slave = settings.slaves.get(nth)?;
    let state = gateway.ethercat()?;
    let layout = state.layout(nth);
    Some((|| {
        write!(out, "{nth}\t{}", slave.unit)?;
        for writes in [false, true] {
            let mut before = "\t";
            for (kind, Cells { count, address }) in slave.tables().filter(|(_, cells)| cells.count > 0) {
                let at = if writes { layout.output(kind) } else { Some(layout.input(kind)) };
                let Some(at) = at else { continue };
                write!(out, "{before}{kind} {address} count {count} at {at}")?;
                before = ", ";
            }
            if before == "\t" {
                out.write_str(before)?;
            }
        }
        Ok(())
    })())
}
