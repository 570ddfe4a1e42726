//! One ESC: what a datagram does to it, and what the processor's accesses do.

use std::task::Waker;

use super::Nanos;
use super::command::{Action, Addressing};
use super::dc::Clock;
use super::eeprom::Eeprom;
use super::events::Events;
use super::fmmu::{self, Fmmu, Mapped};
use super::frame::Datagram;
use super::memory::Memory;
use super::registers::*;
use super::reset::ResetSequence;
use super::sync_manager::{self, Side, SyncManagers};
use super::watchdog::Watchdog;

/// What distinguishes one controller chip from another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Kind {
    /// Registers 0000h to 0003h: type, revision, build.
    pub identity: [u8; 4],
    /// Number of FMMUs.
    pub fmmus: u8,
    /// Number of SyncManagers.
    pub sync_managers: u8,
    /// Process data memory in KByte.
    pub ram_kib: u8,
    /// Features (register 0008h).
    pub features: u16,
    /// Whether an EEPROM read gives eight bytes instead of four.
    pub eeprom_reads_eight: bool,
}

impl Kind {
    /// Microchip's chip with two PHYs, the smallest of the common ones.
    pub const LAN9252: Self = Self {
        identity: [0xC0, 0x02, 0, 0],
        fmmus: 3,
        sync_managers: 4,
        ram_kib: 4,
        features: 0x01CC,
        eeprom_reads_eight: true,
    };
    /// Beckhoff's ASIC.
    pub const ET1100: Self = Self {
        identity: [0x11, 0, 0x02, 0],
        fmmus: 8,
        sync_managers: 8,
        ram_kib: 8,
        features: 0x01CC,
        eeprom_reads_eight: false,
    };
}

/// A byte that a frame writes at its end.
#[derive(Debug, Clone, Copy)]
struct Write {
    datagram: usize,
    address: u16,
    value: u8,
    mask: u8,
}

/// What a frame will have done when it turns out to be good.
#[derive(Debug)]
struct Pending {
    writes: Vec<Write>,
    managers: SyncManagers,
    datagram: usize,
    al_status_read: bool,
    dl_status_read: bool,
}

/// A controller chip with its EEPROM.
#[derive(Debug)]
pub struct Chip {
    pub(super) kind: Kind,
    pub(super) memory: Memory,
    pub(super) managers: SyncManagers,
    pub(super) events: Events,
    pub(super) clock: Clock,
    pub(super) process_watchdog: Watchdog,
    pub(super) pdi_watchdog: Watchdog,
    pub(super) ports: [bool; 4],
    pub(super) ecat_reset: ResetSequence,
    pub(super) pdi_reset: ResetSequence,
    /// The EEPROM; what is changed here the chip sees at its next reset or command.
    pub eeprom: Eeprom,
    waiting: Vec<Waker>,
}

impl Chip {
    /// A chip that has just been switched on, with this content of its EEPROM.
    pub fn new(kind: Kind, eeprom: Vec<u8>) -> Self {
        let mut chip = Self {
            kind,
            memory: Memory::new(usize::from(PROCESS_RAM) + usize::from(kind.ram_kib) * 1024),
            managers: SyncManagers::new(&Memory::new(usize::from(PROCESS_RAM)), kind.sync_managers),
            events: Events::default(),
            clock: Clock::default(),
            process_watchdog: Watchdog::of_process_data(),
            pdi_watchdog: Watchdog::of_pdi(),
            ports: [true, false, false, false],
            ecat_reset: ResetSequence::default(),
            pdi_reset: ResetSequence::default(),
            eeprom: Eeprom::new(eeprom, kind.eeprom_reads_eight),
            waiting: Vec::new(),
        };
        chip.reset();
        chip
    }

    /// Lets the chip's clock show `start` at the beginning of the world, and run faster than the world by `drift_ppm`.
    pub fn set_clock(&mut self, start: Nanos, drift_ppm: i64) {
        self.clock.start = start;
        self.clock.drift_ppm = drift_ppm;
    }

    /// What a register or a byte of memory holds, without the effects of an access. Registers that the chip
    /// computes show what they were at the last access or frame.
    pub fn peek<const N: usize>(&self, address: u16) -> [u8; N] {
        self.memory.bytes(address)
    }

    /// SYNC0 pulses since the SYNC unit was activated.
    pub fn sync0_pulses(&self) -> u64 {
        self.clock.pulses()
    }

    /// Does what became due by `at`, and brings the registers that the chip computes up to date.
    pub fn advance(&mut self, at: Nanos) {
        if self.process_watchdog.advance(&mut self.memory, at) {
            self.events.watchdog = true;
        }
        self.pdi_watchdog.advance(&mut self.memory, at);
        self.clock.advance(&self.memory, at);
        if let Some(config) = self.eeprom.advance(&mut self.memory, at) {
            self.configure(&config);
        }
        self.refresh(at);
    }

    /// When the chip will next do something by itself.
    pub fn next_change(&self, at: Nanos) -> Option<Nanos> {
        let others = [self.process_watchdog.next(), self.pdi_watchdog.next(), self.eeprom.next()];
        others.into_iter().chain([self.clock.next(&self.memory, at)]).flatten().min()
    }

    /// Registers `waker` for the next frame or access.
    pub fn wake_at_change(&mut self, waker: &Waker) {
        if !self.waiting.iter().any(|known| known.will_wake(waker)) {
            self.waiting.push(waker.clone());
        }
    }

    fn wake(&mut self) {
        self.waiting.drain(..).for_each(Waker::wake);
    }

    /// Processes the datagrams of a frame on their way through. Unless the frame is `good` at its end, nothing of it has
    /// happened to the chip, but what it carries on is changed.
    pub(super) fn frame<'f>(&mut self, at: Nanos, datagrams: impl Iterator<Item = Datagram<'f>>, good: bool) {
        self.advance(at);
        let mut pending = Pending {
            writes: Vec::new(),
            managers: self.managers.clone(),
            datagram: 0,
            al_status_read: false,
            dl_status_read: false,
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

    /// Reads and writes from `offset` on; whether at least one byte could be read, and written.
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
        pending.writes.push(Write { datagram: pending.datagram, address, value, mask });
        true
    }

    /// Whether `side` may write a register now.
    fn may_write(&self, side: Side, address: u16) -> bool {
        let sync_owner = if self.memory.byte(SYNC_UNIT) & 1 == 0 { Side::Ecat } else { Side::Pdi };
        let fmmus = FMMU..FMMU + fmmu::BYTES * u16::from(self.kind.fmmus);
        let managers = SYNC_MANAGER..SYNC_MANAGER + sync_manager::BYTES * u16::from(self.kind.sync_managers);
        match address {
            0x0120..=0x0121 => side == Side::Ecat && !self.events.al_control,
            EEPROM_PDI => side == Side::Pdi && self.eeprom.may_be_taken(&self.memory),
            0x0502..=0x050F => self.eeprom.accepts(&self.memory, side),
            _ if fmmus.contains(&address) => side == Side::Ecat && address % fmmu::BYTES < 13,
            _ if managers.contains(&address) => self.may_write_manager(side, address),
            _ if sync_writes(address) => side == sync_owner,
            _ if side == Side::Ecat => ecat_writes(address),
            _ => pdi_writes(address),
        }
    }

    /// The place of the buffer may be changed only while the SyncManager is switched off.
    fn may_write_manager(&self, side: Side, address: u16) -> bool {
        let offset = address % sync_manager::BYTES;
        let active = self.memory.byte(address - offset + sync_manager::ACTIVATE) & 1 != 0;
        match (side, offset) {
            (Side::Ecat, sync_manager::ACTIVATE) => true,
            (Side::Ecat, ..=sync_manager::CONTROL) => !active,
            (Side::Pdi, sync_manager::PDI_CONTROL) => true,
            _ => false,
        }
    }

    /// The end of a good frame: its effects, datagram by datagram.
    fn commit(&mut self, at: Nanos, pending: Pending) {
        self.events.al_status &= !pending.al_status_read;
        self.events.dl_status &= !pending.dl_status_read;
        self.managers = pending.managers;
        for writes in pending.writes.chunk_by(|one, other| one.datagram == other.datagram) {
            for write in writes {
                let kept = self.memory.byte(write.address) & !write.mask;
                self.memory.set_byte(write.address, kept | write.value & write.mask);
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

    /// The processor reads. What it may not read it sees as zeros, and the chip counts that as an error.
    pub fn read(&mut self, at: Nanos, address: u16, into: &mut [u8]) {
        self.advance(at);
        self.clock.show_processor(&mut self.memory, at);
        for (address, byte) in (address..).zip(into.iter_mut()) {
            let place = if address < PROCESS_RAM {
                Some(address)
            } else {
                self.managers.step(Side::Pdi, false, address)
            };
            let place = place.filter(|place| usize::from(*place) < self.memory.len());
            *byte = place.map_or(0, |place| self.memory.byte(place));
            match place {
                Some(address) if address < PROCESS_RAM => self.after_read(address),
                Some(_) => {}
                None => self.count_pdi_error(),
            }
        }
        self.accessed(at);
    }

    /// The processor writes.
    pub fn write(&mut self, at: Nanos, address: u16, bytes: &[u8]) {
        self.advance(at);
        let mut registers = Vec::new();
        for (address, byte) in (address..).zip(bytes) {
            let place = if address < PROCESS_RAM {
                self.may_write(Side::Pdi, address).then_some(address)
            } else {
                self.managers.step(Side::Pdi, true, address)
            };
            match place.filter(|place| usize::from(*place) < self.memory.len()) {
                Some(place) => self.memory.set_byte(place, *byte),
                None => self.count_pdi_error(),
            }
            registers.extend(place.filter(|place| *place < PROCESS_RAM));
        }
        for address in registers {
            self.after_write(Side::Pdi, address, at);
        }
        self.managers.take_watchdog_trigger();
        self.accessed(at);
    }

    /// Whether the chip asks for the processor's attention.
    pub fn interrupt(&mut self, at: Nanos) -> bool {
        self.advance(at);
        self.memory.double_word(AL_EVENT) & self.memory.double_word(AL_EVENT_MASK) != 0
    }

    fn accessed(&mut self, at: Nanos) {
        self.pdi_watchdog.trigger(&self.memory, at);
        self.refresh(at);
        self.wake();
    }

    fn count_pdi_error(&mut self) {
        let counter = PROCESSING_ERRORS + 1;
        self.memory.set_byte(counter, self.memory.byte(counter).saturating_add(1));
    }
}
