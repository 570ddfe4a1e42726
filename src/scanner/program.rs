//! The numeric interface for programs: a master of the gateway's own unit, or an EtherCAT MainDevice.
//!
//! A program chooses a number, the *requester*, and writes it with an [`Operation`] to the row's command register. There it reads
//! the requester whose command was accepted last, and its progress. While a command is in progress, those of other requesters are
//! refused, so each program can tell whether its own was accepted. The commands do the same as the console's.

use embassy_time::{Duration, Instant};
use strum::EnumCount;

use super::operation::{Command, Operation, Progress};
use super::row::{DeviceId, Entry, RowId};
use super::status::Status;
use super::{Refused, Scanner};
use crate::scanner::Kind;

/// Requester numbers, from 0 on.
pub const REQUESTERS: u8 = 32;
/// A safe write ends by itself after this long: its requester is gone.
pub const ABANDONED_AFTER: Duration = Duration::from_secs(60);

impl Scanner {
    /// The command register of row `id`: the requester in the high byte, the progress in the low one.
    pub fn command(&self, id: RowId) -> Option<u16> {
        let command = self.variable(id)?.command;
        Some(u16::from_be_bytes([command.requester(), command.progress().number()]))
    }

    /// How many commands of `requester` are in progress (high byte) and have failed (low byte).
    pub fn commands_of(&self, requester: u8) -> u16 {
        let [mut under_way, mut failed] = [0; 2];
        let commands = self.entries.iter().map(|entry| entry.command);
        for progress in commands.filter(|command| command.requester() == requester).map(Command::progress) {
            under_way += u8::from(progress.is_under_way());
            failed += u8::from(progress == Progress::Failed);
        }
        u16::from_be_bytes([under_way, failed])
    }

    /// Executes `command` on row `id`: the requester in the high byte, an [`Operation`] in the low one.
    pub fn start(&mut self, id: RowId, command: u16, now: Instant) -> Result<(), Refused> {
        // A row that shows another's variable stands for that row.
        let id = self.entry(id).ok_or(Refused::NotThere)?.row.of.unwrap_or(id);
        let (requester, operation) = split(command)?;
        let operation = Operation::from_repr(operation).ok_or(Refused::Value)?;
        if self.is_taken(id, requester) {
            return Err(Refused::Taken);
        }
        self.operate(id, requester, operation, now)
    }

    /// Reads or writes immediately all rows of a device with cells in a range, or none. The command is: requester (high byte) and
    /// device (low byte), function, first cell, number of cells.
    pub fn start_range(&mut self, command: [u16; 4], now: Instant) -> Result<(), Refused> {
        let [whose, function, first, count] = command;
        let (requester, device) = split(whose)?;
        let device = DeviceId(device);
        self.station(device).ok_or(Refused::NotThere)?;
        let function = u8::try_from(function).ok().filter(|code| Kind::of_function(*code).is_some());
        let function = function.ok_or(Refused::Value)?;
        let last = count.checked_sub(1).and_then(|more| first.checked_add(more)).ok_or(Refused::Value)?;
        let mut taken = false;
        let range = (device, function, first, last);
        self.each_in_range(range, &mut |scanner, id, _| {
            taken |= scanner.is_taken(id, requester) || scanner.is_blocked(id);
            Ok(())
        })?;
        if taken {
            return Err(Refused::Taken);
        }
        let operation = |write| if write { Operation::Write } else { Operation::Read };
        let done = self.each_in_range(range, &mut |scanner, id, write| {
            scanner.operate(id, requester, operation(write), now)
        });
        done.map(|_| ())
    }

    /// Whether a command of another requester is in progress.
    fn is_taken(&self, id: RowId, requester: u8) -> bool {
        let command = self.entry(id).map_or(Command::NONE, |entry| entry.command);
        command.progress().is_under_way() && command.requester() != requester
    }

    fn is_blocked(&self, id: RowId) -> bool {
        self.entry(id).is_some_and(|entry| entry.status.any(Status::WRITE_BLOCKED))
    }

    fn operate(
        &mut self,
        id: RowId,
        requester: u8,
        operation: Operation,
        now: Instant,
    ) -> Result<(), Refused> {
        let begun = self.entry(id).is_some_and(|entry| entry.command.progress() == Progress::Begun);
        let mut progress = match operation {
            Operation::Read => self.read(id, now).map(|()| Progress::ReadWaits),
            Operation::Write => self.write(id).map(|()| Progress::WriteWaits),
            // The requester missed the first confirmation.
            Operation::Begin if begun => Ok(Progress::Begun),
            Operation::Begin => self.begin(id, now).map(|()| Progress::Begun),
            // Begun by the console.
            Operation::Finish if self.is_blocked(id) && !begun => Err(Refused::Blocked),
            Operation::Finish => self.finish(id).map(|()| Progress::WriteWaits),
        };
        // Otherwise it would stay in progress until the device responds again, and lock out all other requesters.
        let held = self.status(id, now).any(Status::BACKING_OFF);
        if matches!(progress, Err(Refused::BackingOff(_))) || held && progress == Ok(Progress::WriteWaits) {
            progress = Ok(Progress::Failed);
        }
        let command = Command::new(requester, progress?);
        if let Some(entry) = self.entries.get_mut(usize::from(id.0)) {
            entry.command = command;
        }
        Ok(())
    }

    /// Ends safe writes that were abandoned.
    pub(super) fn abandon(&mut self, now: Instant) {
        for at in 0..self.entries.len() {
            let Some(entry) = self.entries.get_mut(at).filter(|entry| entry.abandoned_at() <= now) else {
                continue;
            };
            entry.abandon();
            // The values may be a mix of old and new: restores a consistent set from the device.
            self.mark(RowId(at as u8), false);
        }
    }
}

impl Entry {
    /// When its safe write is abandoned, if there is one.
    pub(super) fn abandoned_at(&self) -> Instant {
        if self.status.any(Status::WRITE_BLOCKED) { self.fresh + ABANDONED_AFTER } else { Instant::MAX }
    }

    fn abandon(&mut self) {
        self.status.clear(Status::WRITE_BLOCKED.with(Status::WRITE_MARKED).with(Status::WRITE_REMARKED));
        self.fresh = Instant::MIN;
        self.command.abandoned();
    }
}

/// The requester in the high byte of `command`, and the low byte.
fn split(command: u16) -> Result<(u8, u8), Refused> {
    let [requester, low] = command.to_be_bytes();
    if requester < REQUESTERS { Ok((requester, low)) } else { Err(Refused::Value) }
}

const _: () = assert!(REQUESTERS as usize * Progress::COUNT == 256, "a command is a byte");
