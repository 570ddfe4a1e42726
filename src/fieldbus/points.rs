//! The objects of data points (2040h to 2043h): for a MainDevice, the same commands as the registers of the own unit for masters.

use core::mem;

use embassy_time::Instant;
use ethercat_subdevice::coe::abort::Abort;

use crate::scanner::{Refused, RowId, ScannerState};

/// Access to the points of a gateway, if it has any.
#[derive(Default)]
pub(super) struct PointObjects<'p> {
    scanner: Option<&'p ScannerState>,
    /// 2042h, written entry by entry.
    range: [u16; 4],
    /// Why the last write was refused.
    refused: Option<Refused>,
}

impl<'p> PointObjects<'p> {
    pub(super) fn new(scanner: Option<&'p ScannerState>) -> Self {
        Self { scanner, ..Self::default() }
    }

    /// The value of entry `nth`, from 0, of the object `index`; 0 for points that do not exist.
    pub(super) fn number(&self, index: u16, nth: usize) -> Option<u16> {
        let id = RowId(nth as u8);
        Some(match (index, self.scanner) {
            (0x2042, _) => *self.range.get(nth)?,
            (_, None) => 0,
            (0x2040, Some(state)) => state.with(|scanner| scanner.command(id)).unwrap_or(0),
            (0x2041, Some(state)) => state.with(|scanner| scanner.status(id, Instant::now()).bits()),
            (_, Some(state)) => state.with(|scanner| scanner.commands_of(nth as u8)),
        })
    }

    /// Writes `value` to the entry `sub` of the object `index`.
    pub(super) fn write(&mut self, index: u16, sub: u8, value: u16) {
        let nth = sub.saturating_sub(1);
        if index == 0x2042 {
            self.range.iter_mut().skip(nth.into()).take(1).for_each(|entry| *entry = value);
            if usize::from(sub) < self.range.len() {
                return;
            }
        }
        let (range, now) = (self.range, Instant::now());
        let done = self.scanner.ok_or(Refused::NotThere).and_then(|state| {
            state.change(|scanner| match index {
                0x2040 => scanner.start(RowId(nth), value, now),
                _ => scanner.start_range(range, now),
            })
        });
        // Of several written together, the first error is reported.
        self.refused = self.refused.or(done.err());
    }

    /// The outcome of the last write.
    pub(super) fn outcome(&mut self) -> Result<(), Abort> {
        Err(match mem::take(&mut self.refused) {
            None => return Ok(()),
            Some(Refused::NotThere | Refused::NoDevice) => Abort::NoEntry,
            Some(Refused::Value | Refused::ReadOnly | Refused::NotBlocked) => Abort::Range,
            Some(Refused::Taken | Refused::Blocked | Refused::BackingOff(_)) => Abort::State,
        })
    }
}
