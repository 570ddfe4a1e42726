//! SyncManagers: memory exchanged between the MainDevice and the processor, as a mailbox or by three buffers (I, SyncManager; II,
//! 0800h to 087Fh).
//!
//! The state lives beside the registers and is stepped byte by byte. It is small and [`Copy`]: a frame steps a copy, which replaces
//! the state if the frame was good.

use crate::memory::Memory;
use crate::registers::SYNC_MANAGER;

/// Registers of one SyncManager.
pub const BYTES: u16 = 8;
/// Offsets of its registers.
pub(crate) const CONTROL: u16 = 4;
pub(crate) const STATUS: u16 = 5;
pub(crate) const ACTIVATE: u16 = 6;
pub(crate) const PDI_CONTROL: u16 = 7;
/// In PDI control: the processor switches it off.
pub(crate) const OFF: u8 = 1;
/// Buffer number in the status while none has been written.
const NEVER_WRITTEN: u8 = 3;

/// Side of an access to a chip's memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The MainDevice, by frames.
    Ecat,
    /// The processor, at the process data interface.
    Pdi,
}

/// A SyncManager's register settings.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Setup {
    start: u16,
    length: u16,
    control: u8,
    enabled: bool,
    /// Switched on by the MainDevice, but off by the processor.
    held: bool,
    /// End of its last buffer, exclusive.
    end: u16,
    /// The registers that these settings come from.
    registers: [u8; 8],
}

impl Setup {
    fn of(memory: &Memory, nth: usize) -> Self {
        let base = SYNC_MANAGER + BYTES * nth as u16;
        let registers = memory.bytes(base);
        let [start_low, start_high, length_low, length_high, control, _, activate, pdi_control] = registers;
        let start = u16::from_le_bytes([start_low, start_high]);
        let length = u16::from_le_bytes([length_low, length_high]);
        let activated = activate & 1 != 0 && length > 0;
        let held = activated && pdi_control & 1 != 0;
        let enabled = activated && !held;
        let mut setup = Self { start, length, control, enabled, held, end: start, registers };
        if activated {
            let buffers = if setup.is_mailbox() || setup.is_direct() { 1 } else { 3 };
            setup.end = start.saturating_add(length.saturating_mul(buffers));
        }
        setup
    }

    pub(crate) fn is_mailbox(&self) -> bool {
        self.control & 0b11 == 0b10
    }

    pub(crate) fn producer(&self) -> Side {
        if self.control & 0b1100 == 0b0100 { Side::Ecat } else { Side::Pdi }
    }

    pub(crate) fn triggers_watchdog(&self) -> bool {
        self.control & 0x40 != 0
    }

    /// The address of byte `offset` in a buffer; `None` beyond the memory.
    fn place(&self, buffer: u16, offset: u16) -> Option<u16> {
        buffer.checked_mul(self.length)?.checked_add(self.start)?.checked_add(offset)
    }

    /// A single byte in buffered mode is not buffered.
    fn is_direct(&self) -> bool {
        !self.is_mailbox() && self.length == 1
    }
}

/// A SyncManager's state beside its registers.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct State {
    write_event: bool,
    read_event: bool,
    full: bool,
    writing: bool,
    reading: bool,
    write_buffer: u16,
    read_buffer: u16,
    latest: Option<u16>,
    /// A buffer was completely written since this was last taken.
    completed: bool,
}

impl State {
    /// The status register.
    pub(crate) fn status(&self) -> u8 {
        let latest = self.latest.map_or(NEVER_WRITTEN, |buffer| buffer as u8);
        u8::from(self.write_event)
            | u8::from(self.read_event) << 1
            | u8::from(self.full) << 3
            | latest << 4
            | u8::from(self.reading) << 6
            | u8::from(self.writing) << 7
    }

    /// Whether `side` has an event: data to fetch, or room for more.
    pub(crate) fn event_for(&self, side: Side, setup: Setup) -> bool {
        let enabled = setup.control & if side == Side::Ecat { 0x10 } else { 0x20 } != 0;
        enabled && if setup.producer() == side { self.read_event } else { self.write_event }
    }

    /// Steps for `count` bytes that `side` writes; returns the address of the first, or `None` if the write is refused.
    pub(crate) fn write(&mut self, setup: Setup, side: Side, offset: u16, count: u16) -> Option<u16> {
        if side != setup.producer() || setup.is_mailbox() && self.full {
            return None;
        }
        if offset == 0 {
            self.writing = true;
            self.read_event = false;
            self.write_buffer = self.free_buffer(setup);
        }
        if !self.writing {
            return None;
        }
        if offset + count == setup.length {
            self.writing = false;
            self.write_event = true;
            self.completed = true;
            self.full = setup.is_mailbox();
            self.latest = Some(self.write_buffer);
        }
        setup.place(self.write_buffer, offset)
    }

    /// Steps for `count` bytes that `side` reads; returns the address of the first, or `None` without data for it.
    pub(crate) fn read(&mut self, setup: Setup, side: Side, offset: u16, count: u16) -> Option<u16> {
        if setup.is_direct() {
            self.write_event &= side == setup.producer();
            return Some(setup.start);
        }
        if side == setup.producer() || setup.is_mailbox() && !self.full {
            return None;
        }
        if offset == 0 {
            self.read_buffer = self.latest?;
            self.reading = true;
            self.write_event = false;
        }
        if !self.reading {
            return None;
        }
        if offset + count == setup.length {
            self.reading = false;
            self.read_event = true;
            self.full = false;
        }
        setup.place(self.read_buffer, offset)
    }

    /// A buffer with neither the latest data nor data being read.
    fn free_buffer(&self, setup: Setup) -> u16 {
        if setup.is_mailbox() || setup.is_direct() {
            return 0;
        }
        let taken = |buffer| self.latest == Some(buffer) || self.reading && self.read_buffer == buffer;
        (0..3).find(|&buffer| !taken(buffer)).unwrap_or(0)
    }
}

/// The SyncManagers of a chip, each with its last known settings.
#[derive(Debug, Clone)]
pub(crate) struct SyncManagers(Vec<(Setup, State)>);

impl SyncManagers {
    pub(crate) fn new(memory: &Memory, count: u8) -> Self {
        Self((0..usize::from(count)).map(|nth| (Setup::of(memory, nth), State::default())).collect())
    }

    /// Takes over register changes, and updates the status registers. A SyncManager that is off is cleared.
    pub(crate) fn refresh(&mut self, memory: &mut Memory) {
        for (nth, (setup, state)) in self.0.iter_mut().enumerate() {
            let base = SYNC_MANAGER + BYTES * nth as u16;
            // Status updates are not setting changes.
            if memory.bytes(base) != setup.registers {
                *setup = Setup::of(memory, nth);
            }
            if !setup.enabled {
                *state = State::default();
            }
            let status = state.status();
            memory.set_byte(base + STATUS, status);
            setup.registers[usize::from(STATUS)] = status;
        }
    }

    /// Whether the processor switched off the SyncManager whose PDI control is at `address`.
    pub(crate) fn is_held(&self, address: u16) -> bool {
        let nth = usize::from((address - SYNC_MANAGER) / BYTES);
        self.0.get(nth).is_some_and(|(setup, _)| setup.registers[usize::from(PDI_CONTROL)] & OFF != 0)
    }

    /// Steps for an access by `side`; returns where the byte at `address` really is.
    pub(crate) fn step(&mut self, side: Side, write: bool, address: u16) -> Option<u16> {
        self.steps(side, write, address, 1).0
    }

    /// The same for up to `most` contiguous bytes from `address` on: returns the address of the first, and their count.
    pub(crate) fn steps(&mut self, side: Side, write: bool, address: u16, most: u16) -> (Option<u16>, u16) {
        let mut most = most;
        for (setup, state) in &mut self.0 {
            if address < setup.start || address >= setup.end {
                if setup.start > address && setup.end > setup.start {
                    most = most.min(setup.start - address);
                }
                continue;
            }
            let offset = address - setup.start;
            if setup.held {
                // The working counter tells the MainDevice that nothing was processed.
                return ((side == Side::Pdi).then_some(address), most.min(setup.end - address));
            }
            // The second and third buffer are only accessible through the addresses of the first.
            if offset >= setup.length {
                return (None, most.min(setup.end - address));
            }
            let count = most.min(setup.length - offset);
            let place = match write {
                true => state.write(*setup, side, offset, count),
                false => state.read(*setup, side, offset, count),
            };
            return (place, count);
        }
        (Some(address), most)
    }

    /// Whether a buffer that triggers the watchdog was completely written since the last call.
    pub(crate) fn take_watchdog_trigger(&mut self) -> bool {
        self.0.iter_mut().fold(false, |fed, (setup, state)| {
            fed | (std::mem::take(&mut state.completed) && setup.triggers_watchdog())
        })
    }

    /// The SyncManagers with an event for `side`.
    pub(crate) fn events(&self, side: Side) -> impl Iterator<Item = usize> {
        let told = move |(setup, state): &(Setup, State)| setup.enabled && state.event_for(side, *setup);
        self.0.iter().enumerate().filter(move |(_, manager)| told(manager)).map(|(nth, _)| nth)
    }
}
