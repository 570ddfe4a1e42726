//! One exchange with a device: the next request, and the outcome for its rows.

use embassy_time::Instant;

use super::gather::{Pdu, gather, mask_request, read_request, store_request, take_cells, write_request};
use super::long::LONG_VALUES;
use super::row::{DeviceId, Entry, RowId, Writing};
use super::station::Open;
use super::status::{ErrorCode, Status};
use super::{Request, Scanner};
use crate::modbus::pdu::function::DIAGNOSTICS;

/// The request that checks for a sign of life before a poll, with arbitrary data (Application Protocol 6.8.1).
const CHECK: [u8; 5] = [DIAGNOSTICS, 0, 0, 0xa5, 0x5a];

impl Scanner {
    /// Marks the rows that are due.
    pub(super) fn mark_due(&mut self, now: Instant) {
        let since = now.saturating_duration_since(self.started);
        let turn = self.turn.wrapping_add(1);
        let started = self.started;
        for entry in &mut self.entries {
            let Some(device) = entry.row.device else { continue };
            let Some(station) = self.stations.get_mut(usize::from(device.0)) else { continue };
            let held = station.held().saturating_duration_since(started);
            let Some(due) = entry.due(held).filter(|due| *due <= since) else { continue };
            entry.mark_due(due, since, turn);
            station.pending = true;
            if station.device.check {
                station.check_from.get_or_insert(turn);
            }
            self.turn = turn;
        }
    }

    /// The next request to `device`.
    pub(super) fn ask(&mut self, device: DeviceId, now: Instant) -> Option<Request> {
        let station = self.stations.get_mut(usize::from(device.0))?;
        if station.open.is_some() || !station.pending || station.is_held(now) {
            return None;
        }
        let unit = station.device.unit;
        let entries = &self.entries;
        let turn = |write, repeats| Some((leader(entries, device, write, repeats)?, write, repeats));
        let repeated = match station.repeats {
            Some(Open::Write | Open::Mask | Open::Fetch | Open::Store { .. }) => turn(true, true),
            Some(Open::Read { .. }) => turn(false, true),
            Some(Open::Check) | None => None,
        };
        if repeated.is_none() && station.repeats != Some(Open::Check) {
            // A safe write has begun meanwhile and supersedes it, and the register may change until it ends.
            station.repeats = None;
        }
        let turn = repeated.or_else(|| turn(true, false)).or_else(|| turn(false, false));
        let Some((leader, write, repeats)) = turn else {
            station.pending = false;
            return None;
        };
        let Entry { row: lead, read_turn, .. } = *entries.get(leader)?;
        let is_unchecked = |from| station.repeats == Some(Open::Check) || !write && read_turn >= from;
        if station.check_from.is_some_and(is_unchecked) {
            station.asked(Open::Check);
            let pdu = Pdu::from_slice(&CHECK).unwrap_or_default();
            return Some(Request { device, unit, pdu });
        }
        let extent = gather(&mut self.entries, leader, write, repeats)?;
        let values = &self.values;
        let (open, pdu) = match (write, lead.register_bits(), station.repeats) {
            (false, ..) => (Open::Read { first: extent.first }, read_request(extent)),
            (true, None, _) => {
                (Open::Write, write_request(&self.entries, &lead, extent, values, &station.device))
            }
            (true, Some(bits), Some(open @ Open::Store { register })) => {
                (open, store_request(&lead, bits, register, values))
            }
            (true, Some(_), _) if lead.multiple || station.refuses_masks => {
                (Open::Fetch, read_request(extent))
            }
            (true, Some(bits), _) => (Open::Mask, mask_request(&lead, bits, values)),
        };
        station.asked(open);
        if LONG_VALUES && write {
            self.write_again_later(device, now);
        }
        Some(Request { device, unit, pdu })
    }

    /// Records when the rows that are being written are written again.
    fn write_again_later(&mut self, device: DeviceId, now: Instant) {
        let entries = self.entries.iter_mut().filter(|entry| entry.row.device == Some(device));
        for entry in entries.filter(|entry| entry.status.any(Status::CURRENT_IS_WRITE)) {
            entry.again.sent(entry.row.write.period(), now);
        }
    }

    /// Marks the rows that are to be written again by now.
    pub(super) fn mark_again(&mut self, now: Instant) {
        if !LONG_VALUES {
            return;
        }
        for at in 0..self.entries.len() {
            let is_due = |entry: &Entry| entry.again.due(entry.status) <= now;
            if self.entries.get(at).is_some_and(is_due) {
                self.mark(RowId(at as u8), true);
            }
        }
    }

    /// Continues with `open`, the second half of what is in progress at `device`, before anything else.
    pub(super) fn go_on(&mut self, device: DeviceId, open: Open) {
        if let Some(station) = self.stations.get_mut(usize::from(device.0)) {
            station.repeats = Some(open);
        }
        self.unanswered(device, ErrorCode::Unknown, true);
    }

    /// Handles a pending request without response, or with only its first half done: its rows wait again, to be sent `again` as
    /// one frame; otherwise reads are dropped, and writes wait for the next attempt.
    pub(super) fn unanswered(&mut self, device: DeviceId, error: ErrorCode, again: bool) {
        let entries = self.entries.iter_mut().filter(|entry| entry.row.device == Some(device));
        for entry in entries {
            entry.repeats = entry.status.any(Status::IN_PROGRESS);
            if entry.repeats {
                let write = entry.status.leave();
                if !again {
                    entry.end(write, Err(error));
                }
                entry.status.set(if write { Status::WRITE_MARKED } else { Status::READ_MARKED });
                entry.status.clear(Status::WRITE_REMARKED);
            }
            if !again {
                entry.drop_read();
                entry.command.left_alone();
            }
        }
    }

    /// Leaves the device out of this poll.
    pub(super) fn skip_poll(&mut self, device: DeviceId) {
        for entry in self.entries.iter_mut().filter(|entry| entry.row.device == Some(device)) {
            entry.drop_read();
        }
        if let Some(station) = self.stations.get_mut(usize::from(device.0)) {
            station.check_from = None;
        }
    }

    /// Finishes the rows of the pending request.
    pub(super) fn end(
        &mut self,
        device: DeviceId,
        now: Instant,
        outcome: Result<Open, ErrorCode>,
        response: &[u8],
    ) {
        let Some(station) = self.stations.get(usize::from(device.0)) else { return };
        let turn = self.turn.wrapping_add(1);
        let in_progress =
            |entry: &&mut Entry| entry.row.device == Some(device) && entry.status.any(Status::IN_PROGRESS);
        for entry in self.entries.iter_mut().filter(in_progress) {
            let write = entry.status.leave();
            entry.end(write, outcome.map(|_| ()));
            if entry.status.any(Status::WRITE_REMARKED) {
                entry.status.clear(Status::WRITE_REMARKED);
                entry.status.set(Status::WRITE_MARKED);
                entry.write_turn = turn;
                self.turn = turn;
            }
            let Ok(Open::Read { first }) = outcome else { continue };
            let row = entry.row;
            let mine = Status::WRITE_MARKED.with(Status::WRITE_BLOCKED);
            // The program has written a newer value.
            if row.is_one_variable() && entry.status.any(mine) {
                continue;
            }
            let into = self.values.span_mut(row.input, row.bytes());
            take_cells(&row, first, response, &station.device, into);
            entry.fresh = now;
            let differs = row.differs(&self.values);
            if row.write == Writing::OnChange && self.outputs && differs {
                entry.status.set(Status::WRITE_MARKED);
                entry.write_turn = turn;
                self.turn = turn;
            }
        }
    }
}

/// The row of `device` to write or read next, or to repeat.
fn leader(entries: &[Entry], device: DeviceId, write: bool, repeats: bool) -> Option<usize> {
    let marked = if write { Status::WRITE_MARKED } else { Status::READ_MARKED };
    let waiting = entries.iter().enumerate().filter(|(_, entry)| {
        let Entry { row, status, .. } = entry;
        let may = status.any(marked) && !status.any(Status::WRITE_BLOCKED) && (entry.repeats || !repeats);
        may && row.device == Some(device)
    });
    let rank = |(_, entry): &(usize, &Entry)| {
        let turn = if write { entry.write_turn } else { entry.read_turn };
        (turn, entry.row.kind, entry.row.first)
    };
    waiting.min_by_key(rank).map(|(at, _)| at)
}
