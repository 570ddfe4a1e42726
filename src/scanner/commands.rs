//! Commands on rows: their values and status, immediate reads and writes, and safe writes.

use embassy_time::{Duration, Instant};

use super::Scanner;
use super::bits::{bit, copy_bits};
use super::kind::Kind;
use super::row::{DeviceId, Entry, Row, RowId, Writing};
use super::station::{Device, DeviceStatus};
use super::status::Status;

/// Why a command cannot be executed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Refused {
    /// There is no such row, or not so many cells.
    #[error("there are no such cells")]
    NotThere,
    /// The row is read-only.
    #[error("it cannot be written")]
    ReadOnly,
    /// The row has no device.
    #[error("no device is read for it")]
    NoDevice,
    /// The device does not respond, and backs off: a read would come too early.
    #[error("its device does not respond; next attempt in {}s", .0.as_secs() + 1)]
    BackingOff(Duration),
    /// A safe write is in progress.
    #[error("a safe write has begun")]
    Blocked,
    /// No safe write is in progress.
    #[error("no safe write has begun")]
    NotBlocked,
    /// Another requester's command is in progress.
    #[error("another requester's command is in progress")]
    Taken,
    /// There is no such command, or the value has more bits than the cells.
    #[error("there is no such command")]
    Value,
}

impl Scanner {
    /// The parameters of the row.
    pub fn row(&self, id: RowId) -> Option<&Row> {
        self.entry(id).map(|entry| &entry.row)
    }

    /// The parameters of the device.
    pub fn device(&self, id: DeviceId) -> Option<&Device> {
        self.station(id).map(|station| &station.device)
    }

    /// The row's status word at `now`; a row that shows another's variable has the status of that.
    pub fn status(&self, id: RowId, now: Instant) -> Status {
        let Some(entry) = self.variable(id) else { return Status::NEW };
        let station = entry.row.device.and_then(|device| self.station(device));
        let held = station.is_some_and(|station| station.is_held(now));
        if held { entry.status.with(Status::BACKING_OFF) } else { entry.status }
    }

    /// The age of the row's values; `None` if they have never been read.
    pub fn age(&self, id: RowId, now: Instant) -> Option<Duration> {
        let fresh = self.variable(id)?.fresh;
        (fresh != Instant::MIN).then(|| now.saturating_duration_since(fresh))
    }

    /// The status of the device at `now`.
    pub fn device_status(&self, id: DeviceId, now: Instant) -> Option<DeviceStatus> {
        let station = self.station(id)?;
        let backs_off_until = station.is_held(now).then(|| station.held());
        Some(DeviceStatus { backs_off_until, ..station.status })
    }

    /// The values read last: bits packed from the lowest on, or registers with the high byte first.
    pub fn input(&self, id: RowId) -> &[u8] {
        let row = self.variable(id).map(|entry| &entry.row);
        row.map_or(&[], |row| self.values.span(row.input, row.bytes()))
    }

    /// A part of the memory, for a process image.
    pub fn image(&self, first: u16, bytes: u16) -> &[u8] {
        self.values.span(first, bytes)
    }

    /// The same, writable. Rows that are written on change notice at their next read.
    pub fn image_mut(&mut self, first: u16, bytes: u16) -> &mut [u8] {
        self.values.span_mut(first, bytes)
    }

    /// Whether outputs that differ from what was read back are written; off after a restart. Switching it off drops pending
    /// writes.
    pub fn set_outputs(&mut self, on: bool) {
        self.outputs = on;
        let images = self.entries.iter_mut().filter(|entry| entry.row.write == Writing::OnChange);
        if !on {
            images.for_each(|entry| entry.status.clear(Status::WRITE_MARKED));
        }
    }

    /// Writes `count` cells of the row's variable from cell `from` on. A row that is written automatically is marked, even if the
    /// values stay the same; one that is written on change only if they differ, or could not be written.
    pub fn put(
        &mut self,
        id: RowId,
        from: u16,
        count: u16,
        cells: &[u8],
        now: Instant,
    ) -> Result<(), Refused> {
        let id = self.entry(id).and_then(|entry| entry.row.of).unwrap_or(id);
        let entry = self.entries.get_mut(usize::from(id.0)).ok_or(Refused::NotThere)?;
        let row = entry.row;
        let (kind, size) = row.variable();
        let fits = from.checked_add(count).is_some_and(|end| end <= size);
        if !fits || cells.len() < usize::from(kind.bytes(count)) {
            return Err(Refused::NotThere);
        }
        if row.device.is_some() && row.write == Writing::Never {
            return Err(Refused::ReadOnly);
        }
        if row.register_bits().is_some_and(|bits| !bits.hold(cells)) {
            return Err(Refused::Value);
        }
        // What is written periodically is the outputs, until this is written.
        let into = if row.write.period().is_some() { row.input } else { row.output };
        let own = self.values.span_mut(into, kind.bytes(size));
        let (from, count) = (usize::from(from), usize::from(count));
        let mut changes = false;
        if kind.is_bits() {
            changes = (0..count).any(|at| bit(cells, at) != bit(own, from + at));
            copy_bits(cells, 0, own, from, count);
        } else if let (Some(own), Some(cells)) =
            (own.get_mut(2 * from..2 * (from + count)), cells.get(..2 * count))
        {
            changes = own != cells;
            own.copy_from_slice(cells);
        }
        if row.device.is_none() || entry.status.any(Status::WRITE_BLOCKED) {
            entry.fresh = now;
        }
        let failed = entry.status.any(Status::LAST_ERROR) && entry.status.any(Status::LAST_WAS_WRITE);
        if row.write.is_auto() || row.write == Writing::OnChange && (changes || failed) {
            self.mark_written(id);
        }
        Ok(())
    }

    /// Reads the row immediately.
    pub fn read(&mut self, id: RowId, now: Instant) -> Result<(), Refused> {
        let entry = self.entry(id).ok_or(Refused::NotThere)?;
        let station = entry.row.device.and_then(|device| self.station(device)).ok_or(Refused::NoDevice)?;
        if station.is_held(now) {
            return Err(Refused::BackingOff(station.held() - now));
        }
        if entry.status.any(Status::WRITE_BLOCKED) {
            return Err(Refused::Blocked);
        }
        self.mark(id, false);
        Ok(())
    }

    /// Writes the row immediately; a device that does not respond gets it at the next attempt.
    pub fn write(&mut self, id: RowId) -> Result<(), Refused> {
        self.writable(id)?;
        self.mark_written(id);
        Ok(())
    }

    /// The row, if it is one that is written and is in no safe write.
    fn writable(&mut self, id: RowId) -> Result<&mut Entry, Refused> {
        let entry = self.entries.get_mut(usize::from(id.0)).ok_or(Refused::NotThere)?;
        entry.row.device.ok_or(Refused::NoDevice)?;
        if entry.row.write == Writing::Never {
            return Err(Refused::ReadOnly);
        }
        if entry.status.any(Status::WRITE_BLOCKED) {
            return Err(Refused::Blocked);
        }
        Ok(entry)
    }

    /// Reads or writes immediately, depending on `function`, all rows of `device` with cells from `first` to `last`; returns the
    /// number of rows, or why there are none.
    pub fn mark_range(
        &mut self,
        device: DeviceId,
        function: u8,
        first: u16,
        last: u16,
        now: Instant,
    ) -> Result<usize, Refused> {
        let mark = &mut |scanner: &mut Self, id, write| {
            if write { scanner.write(id) } else { scanner.read(id, now) }
        };
        self.each_in_range((device, function, first, last), mark)
    }

    /// Calls `act` for all rows of a device with cells in a range, and whether `function` writes; returns the number of rows for
    /// which it succeeded, or why there are none.
    pub(super) fn each_in_range(
        &mut self,
        (device, function, first, last): (DeviceId, u8, u16, u16),
        act: &mut dyn FnMut(&mut Self, RowId, bool) -> Result<(), Refused>,
    ) -> Result<usize, Refused> {
        let (kind, write) = Kind::of_function(function).ok_or(Refused::NotThere)?;
        let mut marked = 0;
        let mut refused = Refused::NotThere;
        for at in 0..self.entries.len() {
            let id = RowId(at as u8);
            let Some(row) = self.row(id) else { break };
            let touched = u32::from(first) < row.end() && row.first <= last;
            if row.device != Some(device) || row.kind != kind || !touched {
                continue;
            }
            match act(self, id, write) {
                Ok(()) => marked += 1,
                Err(why) => refused = why,
            }
        }
        if marked == 0 { Err(refused) } else { Ok(marked) }
    }

    /// Begins a safe write: until it is finished the row is neither read nor written, so that several cells can be changed and
    /// the device gets all of them in one frame. It ends after [`ABANDONED_AFTER`](super::ABANDONED_AFTER) without effect.
    pub fn begin(&mut self, id: RowId, now: Instant) -> Result<(), Refused> {
        let entry = self.writable(id)?;
        entry.status.set(Status::WRITE_BLOCKED);
        entry.fresh = now;
        Ok(())
    }

    /// Finishes a safe write: the row is written.
    pub fn finish(&mut self, id: RowId) -> Result<(), Refused> {
        let entry = self.entries.get_mut(usize::from(id.0)).ok_or(Refused::NotThere)?;
        if !entry.status.any(Status::WRITE_BLOCKED) {
            return Err(Refused::NotBlocked);
        }
        entry.status.clear(Status::WRITE_BLOCKED);
        entry.command.finished();
        self.mark_written(id);
        Ok(())
    }

    /// Marks the row as its variable is to be written. A periodic write writes that from now on, unless a safe write is in progress.
    fn mark_written(&mut self, id: RowId) {
        if let Some(Entry { row, status, .. }) =
            self.entry(id).filter(|entry| entry.row.write.period().is_some())
            && !status.any(Status::WRITE_BLOCKED)
        {
            let (row, bytes) = (*row, row.bytes());
            self.values.copy(row.input, row.output, bytes);
        }
        self.mark(id, true);
    }

    /// Whether the value that was written last is written again; not before a first write.
    pub fn is_written_again(&self, id: RowId) -> bool {
        self.variable(id).is_some_and(|entry| entry.again.is_armed())
    }

    pub(super) fn mark(&mut self, id: RowId, write: bool) {
        let Some(entry) = self.entries.get_mut(usize::from(id.0)) else { return };
        let Some(device) = entry.row.device else { return };
        let turn = self.turn.wrapping_add(1);
        let Entry { status, .. } = entry;
        match write {
            true if status.any(Status::CURRENT_IS_WRITE) => status.set(Status::WRITE_REMARKED),
            // It keeps its turn.
            true if status.any(Status::WRITE_MARKED) => {}
            true => {
                status.set(Status::WRITE_MARKED);
                entry.write_turn = turn;
            }
            false if status.any(Status::READ_MARKED) => {}
            false => {
                status.set(Status::READ_MARKED);
                entry.read_turn = turn;
            }
        }
        self.turn = turn;
        if let Some(station) = self.stations.get_mut(usize::from(device.0)) {
            station.pending = true;
        }
    }

    pub(super) fn entry(&self, id: RowId) -> Option<&Entry> {
        self.entries.get(usize::from(id.0))
    }

    /// The row whose variable the row `id` shows: itself, or another one.
    pub(super) fn variable(&self, id: RowId) -> Option<&Entry> {
        let entry = self.entry(id)?;
        entry.row.of.map_or(Some(entry), |of| self.entry(of))
    }
}
