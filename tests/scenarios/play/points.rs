//! What steps do with data points, and look for in them.

use embassy_time::Instant;
use mobgate::scanner::{DeviceId, RowId, ScannerState, ValueType};
use mobgate::settings::PointSettings;

use super::Stage;
use super::acts::equal;
use crate::words::number;

impl Stage<'_, '_, '_> {
    /// Acts on the point called `name`.
    pub(super) fn point(&self, name: &str, what: &[&str]) -> Result<(), String> {
        let state = self.scanner()?;
        let (id, point) = self
            .rig
            .gateway
            .settings(|settings| {
                let id = settings.find_point(name)?;
                Some((RowId(id), settings.points[usize::from(id)].clone()))
            })
            .ok_or("there is no such point")?;
        let now = Instant::now();
        let done = match what {
            ["is", status @ ..] => {
                let is = state.with(|scanner| scanner.status(id, now));
                return equal("the status", is.to_string(), status.join(" "));
            }
            ["holds", values @ ..] => {
                let is = state.with(|scanner| shown(&point, scanner.input(id)));
                return equal("the values", is, values.join(" "));
            }
            [":", "read"] => state.change(|scanner| scanner.read(id, now)),
            [":", "write"] => state.change(|scanner| scanner.write(id)),
            [":", "write", values @ ..] => {
                let cells = cells(&point, values)?;
                state.change(|scanner| scanner.put(id, 0, point.count * point.value.registers(), &cells, now))
            }
            [":", "begin"] => state.change(|scanner| scanner.begin(id, now)),
            [":", "finish"] => state.change(|scanner| scanner.finish(id)),
            _ => {
                return Err(
                    "a point is something, holds values, or is read, written, begun or finished".into()
                );
            }
        };
        done.map_err(|refused| refused.to_string())
    }

    pub(super) fn mark(&self, device: &str, function: u8, range: &str) -> Result<(), String> {
        let id = self.rig.gateway.settings(|settings| settings.find_device(device));
        let id = DeviceId(id.ok_or("there is no such device")?);
        let (first, last) = range.split_once('-').unwrap_or((range, range));
        let (first, last) = (number(first)?, number(last)?);
        let mark =
            self.scanner()?.change(|scanner| scanner.mark_range(id, function, first, last, Instant::now()));
        mark.map(|_| ()).map_err(|refused| refused.to_string())
    }

    fn scanner(&self) -> Result<&ScannerState, String> {
        self.rig.gateway.scanner().ok_or_else(|| "the gateway has no data points".to_owned())
    }
}

fn shown(point: &PointSettings, cells: &[u8]) -> String {
    let value = |nth: usize| match point.value == ValueType::Bit {
        true => (cells[nth / 8] >> (nth % 8) & 1).to_string(),
        false => {
            let at = 2 * usize::from(point.value.registers()) * nth;
            let raw = point.value.take(&cells[at..]);
            raw.map_or_else(|| "?".to_owned(), |raw| point.scale.apply(raw).to_string())
        }
    };
    (0..usize::from(point.count)).map(value).collect::<Vec<_>>().join(" ")
}

fn cells(point: &PointSettings, values: &[&str]) -> Result<Vec<u8>, String> {
    if point.value == ValueType::Bit {
        let mut cells = vec![0; values.len().div_ceil(8)];
        for (nth, value) in values.iter().enumerate() {
            cells[nth / 8] |= number::<u8>(value)? << (nth % 8);
        }
        return Ok(cells);
    }
    let registers = usize::from(point.value.registers());
    let parsed = values.iter().map(|value| point.value.parse(value).ok_or("this is no value of the point"));
    let parsed: Vec<_> = parsed.collect::<Result<_, _>>()?;
    Ok(parsed.iter().flat_map(|value| &value[..2 * registers]).copied().collect())
}
