//! What Unicorn is told and calls back: memories, peripherals, blocks of instructions, and those that it takes for nothing.

use std::cell::RefCell;
use std::rc::Rc;

use unicorn_engine::{HookType, Prot, RegisterARM, Unicorn, uc_error};

use crate::bus::Bus;
use crate::chip::{self, Board};
use crate::work::{Block, Work};

pub(crate) type Shared = Rc<RefCell<Bus>>;

/// What the hooks note for the loop.
#[derive(Default)]
pub(crate) struct Notes {
    /// The block that runs, and its length.
    pub(crate) block: u32,
    bytes: u32,
    /// WFE or WFI was met.
    pub(crate) sleeps: bool,
    /// SEV was met, or an exception was taken.
    pub(crate) event: bool,
    /// An access to no memory.
    pub(crate) bad_address: Option<u32>,
    /// The block that may begin a loop, how often it did, accesses to peripherals until then, blocks since then.
    head: u32,
    polls: u32,
    accesses: (u64, u64),
    since: u32,
}

/// So often in a row a loop only reads a register until nothing but an event is waited for. Time goes on to the next one then: a program that
/// hangs until the watchdog ends it would take a minute otherwise.
const POLLS_MAX: u32 = 5_000;
/// The same of the flash that is busy: it is waited for each of the thousands of words that a boot loader copies.
const FLASH_POLLS_MAX: u32 = 16;

impl Notes {
    /// Notes the block that begins, and says how often the program has done nothing but read one register. Where Unicorn has found that an
    /// instruction accesses a peripheral, it is executed as a block of its own.
    fn poll(&mut self, block: u32, accesses: (u64, u64)) -> u32 {
        /// Blocks of such a loop.
        const LOOP_BLOCKS: u32 = 3;
        let (reads, writes) = self.accesses;
        self.since += 1;
        if block == self.head && accesses == (reads + 1, writes) {
            (self.polls, self.accesses, self.since) = (self.polls + 1, accesses, 0);
        } else if self.since > LOOP_BLOCKS {
            (self.head, self.polls, self.accesses, self.since) = (block, 0, accesses, 0);
        }
        self.polls
    }

    /// Notes the block that begins; the part of the last one that was not executed: see [`Self::poll`].
    fn begin(&mut self, block: u32, bytes: u32) -> Option<Block> {
        let end = self.block + self.bytes;
        let is_cut_out = bytes <= 4 && block >= self.block && block + bytes < end;
        (self.block, self.bytes) = (block, bytes);
        is_cut_out.then(|| (block, end - block))
    }
}

pub(crate) fn map(
    unicorn: &mut Unicorn<'static, ()>,
    board: &Board,
    memories: &[Vec<u8>],
    bus: &Shared,
) -> Result<(), uc_error> {
    let code_bytes = board.code_bytes();
    unicorn.mem_map(u64::from(chip::FLASH), u64::from(code_bytes), Prot::READ | Prot::EXEC)?;
    let code = bus.borrow().flash.cells.read(chip::FLASH, code_bytes as usize).to_vec();
    unicorn.mem_write(u64::from(chip::FLASH), &code)?;
    hook_code(unicorn, code_bytes, bus)?;
    for (&(address, length), bytes) in board.memories.iter().zip(memories) {
        // No image has instructions there. Where there may be some, Unicorn takes a long way for each store.
        unicorn.mem_map(u64::from(address), u64::from(length), Prot::READ | Prot::WRITE)?;
        unicorn.mem_write(u64::from(address), bytes)?;
    }
    let regions = [
        (chip::FLASH + code_bytes, chip::FLASH_BYTES - code_bytes),
        (0x1ff0_0000, 0x10_0000),
        (0x4000_0000, 0x2000_0000),
        (0xe000_0000, 0x10_0000),
    ];
    for (base, length) in regions {
        let (reads, writes) = (bus.clone(), bus.clone());
        unicorn.mmio_map(
            u64::from(base),
            u64::from(length),
            Some(move |_: &mut Unicorn<'_, ()>, offset: u64, size: usize| {
                reads.borrow_mut().read(base + offset as u32, size)
            }),
            Some(move |unicorn: &mut Unicorn<'_, ()>, offset: u64, size: usize, value: u64| {
                writes.borrow_mut().write(base + offset as u32, size, value);
                follow_cells(unicorn, code_bytes, &writes);
            }),
        )?;
    }
    Ok(())
}

/// Hands writes into the flash's first part, from which instructions are executed, to its model.
fn hook_code(unicorn: &mut Unicorn<'static, ()>, code_bytes: u32, bus: &Shared) -> Result<(), uc_error> {
    let (bus, base) = (bus.clone(), u64::from(chip::FLASH));
    let end = base + u64::from(code_bytes) - 1;
    unicorn.add_mem_hook(HookType::MEM_WRITE_PROT, base, end, move |unicorn, _, address, size, value| {
        bus.borrow_mut().write(address as u32, size, value as u64);
        follow_cells(unicorn, code_bytes, &bus);
        true
    })?;
    Ok(())
}

/// Lets the first part of the flash be what its cells are.
fn follow_cells(unicorn: &mut Unicorn<'_, ()>, code_bytes: u32, bus: &Shared) {
    let cells = &mut bus.borrow_mut().flash.cells;
    let Some(changed) = cells.changed.take().filter(|changed| changed.start < chip::FLASH + code_bytes)
    else {
        return;
    };
    // It is mapped.
    let _ = unicorn.mem_write(u64::from(changed.start), cells.read(changed.start, changed.len()));
}

pub(crate) fn hook_blocks(
    unicorn: &mut Unicorn<'static, ()>,
    bus: &Shared,
    notes: &Rc<RefCell<Notes>>,
    work: &Rc<RefCell<Work>>,
) -> Result<(), uc_error> {
    let (bus, notes, work) = (bus.clone(), notes.clone(), work.clone());
    unicorn.add_block_hook(1, 0, move |unicorn, address, size| {
        let address = address as u32;
        let (mut bus, mut notes, mut work) = (bus.borrow_mut(), notes.borrow_mut(), work.borrow_mut());
        if let Some(undone) = notes.begin(address, size) {
            let undone = work.take_back(undone, || count(unicorn, undone));
            bus.now -= u64::from(undone) * bus.instruction;
        }
        let polls_max = if bus.waits_for_flash { FLASH_POLLS_MAX } else { POLLS_MAX };
        if notes.poll(address, bus.accesses) > polls_max {
            bus.now = bus.now.max(bus.deadline);
            bus.waits_for_flash = false;
        }
        let unmasked = || unicorn.reg_read(RegisterARM::PRIMASK).is_ok_and(|masked| masked == 0);
        let is_due =
            bus.now >= bus.deadline || bus.core.is_waiting && bus.core.next().is_some() && unmasked();
        if is_due && !is_in_it_block(unicorn) {
            // What is not executed is not cut out of.
            notes.bytes = 0;
            let _ = unicorn.emu_stop();
            return;
        }
        let done = work.add((address, size), || count(unicorn, (address, size)));
        bus.now += u64::from(done) * bus.instruction;
    })?;
    Ok(())
}

/// Whether the next instruction is one that an IT instruction made conditional. Unicorn keeps that state where an exception cannot
/// save it, so none is taken there.
fn is_in_it_block(unicorn: &Unicorn<'_, ()>) -> bool {
    /// The places of these bits in CPSR.
    const IT: u64 = 0x0600_fc00;
    unicorn.reg_read(RegisterARM::CPSR).is_ok_and(|status| status & IT != 0)
}

/// Instructions of a block: one of 32 bits begins with 0b11101, 0b11110 or 0b11111.
fn count(unicorn: &Unicorn<'_, ()>, (address, size): Block) -> u32 {
    let bytes = unicorn.mem_read_as_vec(u64::from(address), size as usize).unwrap_or_default();
    let (mut at, mut count) = (0, 0);
    while let Some(&high) = bytes.get(at + 1) {
        at += if high >> 3 >= 0b11101 { 4 } else { 2 };
        count += 1;
    }
    count
}

/// Hooks WFE, WFI and SEV in `code` at `base`, which Unicorn takes for nothing or for an end. Where the same bits are no instruction, a hook
/// is never called.
pub(crate) fn hook_hints(
    unicorn: &mut Unicorn<'static, ()>,
    base: u32,
    code: &[u8],
    notes: &Rc<RefCell<Notes>>,
) -> Result<(), uc_error> {
    for (nth, pair) in code.chunks_exact(2).enumerate() {
        let address = u64::from(base + 2 * nth as u32);
        let notes = notes.clone();
        match pair {
            [0x40, 0xbf] => {
                unicorn.add_code_hook(address, address, move |_, _, _| notes.borrow_mut().event = true)?;
            }
            [0x20 | 0x30, 0xbf] => {
                unicorn.add_code_hook(address, address, move |unicorn, address, _| {
                    notes.borrow_mut().sleeps = true;
                    let _ = unicorn.reg_write(RegisterARM::PC, (address + 2) | 1);
                    let _ = unicorn.emu_stop();
                })?;
            }
            _ => {}
        }
    }
    Ok(())
}

/// Notes the address of an access to no memory. A hook that reaches into a memory is as bad as instructions there.
pub(crate) fn hook_faults(
    unicorn: &mut Unicorn<'static, ()>,
    board: &Board,
    notes: &Rc<RefCell<Notes>>,
) -> Result<(), uc_error> {
    let memories = board.memories.iter().map(|&(base, length)| (u64::from(base), u64::from(length)));
    let mut begin = 0;
    for (base, length) in memories.chain([(u64::MAX, 0)]) {
        let notes = notes.clone();
        unicorn.add_mem_hook(HookType::MEM_INVALID, begin, base - 1, move |_, _, address, _, _| {
            notes.borrow_mut().bad_address = Some(address as u32);
            false
        })?;
        begin = base + length;
    }
    Ok(())
}
