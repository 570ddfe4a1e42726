//! Processing of a frame by a chip: datagram by datagram, with effects at its end (I, Frame Processing, "Shadow buffer").

use std::ops::Range;

use crate::Nanos;
use crate::chip::Chip;
use crate::command::{Action, Addressing};
use crate::fmmu::{Fmmu, Mapped};
use crate::frame::Datagram;
use crate::registers::*;
use crate::sync_manager::{Side, SyncManagers};

/// Bytes written at the end of the frame.
#[derive(Debug, Clone)]
struct Write {
    datagram: usize,
    address: u16,
    /// Their range in the collected values.
    values: Range<usize>,
    /// The bits written in each byte.
    mask: u8,
}

/// Collected effects of a frame, applied if it turns out good.
#[derive(Debug)]
struct Pending {
    writes: Vec<Write>,
    values: Vec<u8>,
    managers: SyncManagers,
    datagram: usize,
    al_status_read: bool,
    dl_status_read: bool,
    /// First bytes of latched times that were read.
    times_read: Vec<u16>,
}

impl Pending {
    /// Collects a write; a partial `mask` applies to a single byte.
    fn write(&mut self, address: u16, values: &[u8], mask: u8) {
        let start = self.values.len();
        self.values.extend_from_slice(values);
        let values = start..self.values.len();
        self.writes.push(Write { datagram: self.datagram, address, values, mask });
    }
}

impl Chip {
    /// Processes the datagrams of a frame. Unless the frame is `good` at its end, it has no effect on the chip, but is passed on
    /// modified.
    pub(crate) fn frame<'f>(&mut self, at: Nanos, datagrams: impl Iterator<Item = Datagram<'f>>, good: bool) {
        self.advance(at);
        let mut pending = Pending {
            writes: Vec::new(),
            values: Vec::new(),
            managers: self.managers.clone(),
            datagram: 0,
            al_status_read: false,
            dl_status_read: false,
            times_read: Vec::new(),
        };
        for (nth, mut datagram) in datagrams.enumerate() {
            pending.datagram = nth;
            self.datagram(&mut datagram, &mut pending);
        }
        if good {
            self.commit(at, pending);
            self.wake();
        } else {
            let counter = ERROR_COUNTERS;
            self.memory.set_byte(counter, self.memory.byte(counter).saturating_add(1));
        }
    }

    fn datagram(&self, datagram: &mut Datagram<'_>, pending: &mut Pending) {
        let Some(command) = datagram.command() else { return };
        let device = datagram.device();
        let addressed = match command.addressing() {
            Addressing::None => false,
            Addressing::Position => device == 0,
            Addressing::Station => self.is_station(device),
            Addressing::Broadcast | Addressing::Logical => true,
        };
        let action = command.action(addressed);
        let (read, written) = if command.addressing() == Addressing::Logical {
            self.logical(datagram.logical(), datagram.data_mut(), action, pending)
        } else {
            self.physical(datagram.offset(), datagram.data_mut(), action, pending)
        };
        datagram.count(action.counts(read, written));
        if matches!(command.addressing(), Addressing::Position | Addressing::Broadcast) {
            datagram.set_device(device.wrapping_add(1));
        }
        datagram.interrupt(self.memory.word(ECAT_EVENT) & self.memory.word(ECAT_EVENT_MASK));
    }

    fn is_station(&self, device: u16) -> bool {
        let alias_enabled = self.memory.byte(DL_CONTROL + 3) & 1 != 0;
        device == self.memory.word(STATION) || alias_enabled && device == self.memory.word(ALIAS)
    }

    /// Reads and writes from `offset` on; returns whether at least one byte was read, and written.
    fn physical(&self, offset: u16, data: &mut [u8], action: Action, pending: &mut Pending) -> (bool, bool) {
        let (mut read, mut written) = (false, false);
        for (nth, byte) in (0..).zip(data) {
            let Some(address) = offset.checked_add(nth) else { break };
            let sent = *byte;
            if let Some(value) = action.read.then(|| self.ecat_read(address, pending)).flatten() {
                *byte = if action.or { sent | value } else { value };
                read = true;
            }
            written |= action.write && self.ecat_write(address, sent, 0xFF, pending);
        }
        (read, written)
    }

    fn logical(&self, logical: u32, data: &mut [u8], action: Action, pending: &mut Pending) -> (bool, bool) {
        let (mut read, mut written) = (false, false);
        let sent = data.to_vec();
        for fmmu in (0..usize::from(self.kind.fmmus)).filter_map(|nth| Fmmu::of(&self.memory, nth)) {
            if let Some((address, at, count)) = fmmu.mapped_bytes(logical, sent.len())
                && address >= u64::from(PROCESS_RAM)
                && address + count as u64 <= self.memory.len() as u64
            {
                let (address, bytes) = (address as u16, at..at + count);
                if action.write && fmmu.writes {
                    written |= self.ecat_write_all(address, &sent[bytes.clone()], pending);
                }
                if action.read && fmmu.reads {
                    read |= self.ecat_read_all(address, &mut data[bytes], pending);
                }
                continue;
            }
            for mapped in fmmu.mapped(logical, sent.len()) {
                if action.write && fmmu.writes {
                    let Mapped { address, mask, .. } = mapped;
                    written |= self.ecat_write(address, mapped.take(&sent), mask, pending);
                }
                if action.read
                    && fmmu.reads
                    && let Some(value) = self.ecat_read(mapped.address, pending)
                {
                    mapped.put(value, data);
                    read = true;
                }
            }
        }
        (read, written)
    }

    fn ecat_read(&self, address: u16, pending: &mut Pending) -> Option<u8> {
        if usize::from(address) >= self.memory.len() {
            return None;
        }
        let address = if address < PROCESS_RAM {
            pending.al_status_read |= address == AL_STATUS;
            pending.dl_status_read |= address == DL_STATUS;
            if (LATCH_TIMES..LATCH_TIMES + 32).contains(&address) {
                pending.times_read.push(address);
            }
            address
        } else {
            pending.managers.step(Side::Ecat, false, address)?
        };
        let withheld = (EEPROM_DATA..EEPROM_DATA + 8).contains(&address)
            && !self.eeprom.accepts(&self.memory, Side::Ecat);
        (!withheld && usize::from(address) < self.memory.len()).then(|| self.memory.byte(address))
    }

    fn ecat_write(&self, address: u16, value: u8, mask: u8, pending: &mut Pending) -> bool {
        if usize::from(address) >= self.memory.len() {
            return false;
        }
        let address = if address < PROCESS_RAM {
            self.may_write(Side::Ecat, address).then_some(address)
        } else {
            pending.managers.step(Side::Ecat, true, address)
        };
        let Some(address) = address.filter(|address| usize::from(*address) < self.memory.len()) else {
            return false;
        };
        pending.write(address, &[value], mask);
        true
    }

    /// Reads bytes of process data memory; returns whether at least one was read.
    fn ecat_read_all(&self, address: u16, into: &mut [u8], pending: &mut Pending) -> bool {
        let (mut read, mut done) = (false, 0);
        while done < into.len() {
            let most = (into.len() - done) as u16;
            let (place, count) = pending.managers.steps(Side::Ecat, false, address + done as u16, most);
            let found = place.map_or(&[][..], |place| self.memory.span(place, count));
            into[done..done + found.len()].copy_from_slice(found);
            read |= !found.is_empty();
            done += usize::from(count);
        }
        read
    }

    /// Writes bytes of process data memory; returns whether at least one was written.
    fn ecat_write_all(&self, address: u16, bytes: &[u8], pending: &mut Pending) -> bool {
        let (mut written, mut done) = (false, 0);
        while done < bytes.len() {
            let most = (bytes.len() - done) as u16;
            let (place, count) = pending.managers.steps(Side::Ecat, true, address + done as u16, most);
            let room = place.map_or(0, |place| self.memory.span(place, count).len());
            if let Some(place) = place.filter(|_| room > 0) {
                pending.write(place, &bytes[done..done + room], 0xFF);
                written = true;
            }
            done += usize::from(count);
        }
        written
    }

    /// Applies the effects of a good frame, datagram by datagram.
    fn commit(&mut self, at: Nanos, pending: Pending) {
        self.events.al_status &= !pending.al_status_read;
        self.events.dl_status &= !pending.dl_status_read;
        for address in &pending.times_read {
            self.latches.read(&self.memory, Side::Ecat, *address);
        }
        self.managers = pending.managers;
        for writes in pending.writes.chunk_by(|one, other| one.datagram == other.datagram) {
            for write in writes {
                let values = &pending.values[write.values.clone()];
                match (write.mask, values) {
                    (0xFF, values) => self.memory.put(write.address, values),
                    (mask, values) => {
                        let kept = self.memory.byte(write.address) & !mask;
                        self.memory.set_byte(write.address, kept | values[0] & mask);
                    }
                }
            }
            for write in writes.iter().filter(|write| write.address < PROCESS_RAM) {
                self.after_write(Side::Ecat, write.address, at);
            }
        }
        if self.managers.take_watchdog_trigger() {
            self.process_watchdog.trigger(&self.memory, at);
        }
        self.refresh(at);
    }
}
