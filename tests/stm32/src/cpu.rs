//! The processor: Unicorn executes instructions; exceptions, sleeping and time are done here.
//!
//! Unicorn calls back before each block of instructions. Its instructions are counted as time then, and if something is due
//! or an interrupt may be taken, Unicorn is stopped between two blocks. An exception's frame lies on the program's
//! stack as the architecture says (ARMv7-M, B1.5.6); registers of the floating-point unit are kept here instead.

use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;

use unicorn_engine::{Arch, ArmCpuModel, HookType, Mode, Prot, RegisterARM, Unicorn, uc_error};

use crate::bus::{Bus, Memory};
use crate::chip::{self, Board};
use crate::core::HARD_FAULT;
use crate::image::Image;

/// The value of LR that a handler returns to.
const RETURN: u32 = 0xffff_fff9;
/// CFSR.UNDEFINSTR, PRECISERR, IBUSERR.
const UNDEFINED: u32 = 1 << 16;
const BAD_DATA: u32 = 1 << 9;
const BAD_FETCH: u32 = 1 << 8;

pub(crate) type Shared = Rc<RefCell<Bus>>;

/// What the hooks note for the loop.
#[derive(Default)]
struct Notes {
    /// The block that runs, and its length.
    block: u32,
    bytes: u32,
    /// WFE or WFI was met.
    sleeps: bool,
    /// SEV was met, or an exception was taken.
    event: bool,
    /// An access to no memory.
    bad_address: Option<u32>,
    /// The block that may begin a loop, how often it did, accesses to peripherals until then, blocks since then.
    head: u32,
    polls: u32,
    accesses: (u64, u64),
    since: u32,
}

/// So often in a row a loop only reads a register until nothing but an event is waited for. Time goes on to the next one then: a program that
/// hangs until the watchdog ends it would take a minute otherwise.
const POLLS_MAX: u32 = 5_000;

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
    fn begin(&mut self, block: u32, bytes: u32) -> Option<(u32, u32)> {
        let end = self.block + self.bytes;
        let is_cut_out = bytes <= 4 && block >= self.block && block + bytes < end;
        (self.block, self.bytes) = (block, bytes);
        is_cut_out.then(|| (block, end - block))
    }
}

/// The processor.
pub(crate) struct Cpu {
    unicorn: Unicorn<'static, ()>,
    bus: Shared,
    notes: Rc<RefCell<Notes>>,
    /// Floating-point registers of those that were interrupted.
    floats: Vec<Option<(Vec<u64>, u64)>>,
    pub(crate) is_asleep: bool,
    /// The last fault: the instruction, and the address of a failed access.
    pub(crate) last_fault: Option<(u32, Option<u32>)>,
}

struct Ram<'u>(&'u mut Unicorn<'static, ()>);

impl Memory for Ram<'_> {
    fn load(&self, address: u32, bytes: &mut [u8]) {
        // Unmapped memory is an error of the DMA's, which nothing here raises: it reads nothing.
        let _ = self.0.mem_read(u64::from(address), bytes);
    }

    fn store(&mut self, address: u32, bytes: &[u8]) {
        let _ = self.0.mem_write(u64::from(address), bytes);
    }
}

const GENERAL: [RegisterARM; 5] =
    [RegisterARM::R0, RegisterARM::R1, RegisterARM::R2, RegisterARM::R3, RegisterARM::R12];
const FLOATS: [RegisterARM; 8] = [
    RegisterARM::D0,
    RegisterARM::D1,
    RegisterARM::D2,
    RegisterARM::D3,
    RegisterARM::D4,
    RegisterARM::D5,
    RegisterARM::D6,
    RegisterARM::D7,
];

impl Cpu {
    /// A processor behind a reset. `memories` are the contents of the board's.
    pub(crate) fn new(
        board: &Board,
        image: &Image,
        memories: &[Vec<u8>],
        bus: &Shared,
        instructions: &Rc<RefCell<u64>>,
    ) -> Result<Self, uc_error> {
        let mut unicorn = Unicorn::new(Arch::ARM, Mode::THUMB)?;
        unicorn.ctl_set_cpu_model(ArmCpuModel::CORTEX_M7 as i32)?;
        map(&mut unicorn, board, image, memories, bus)?;
        let notes = Rc::new(RefCell::new(Notes::default()));
        hook_blocks(&mut unicorn, bus, &notes, instructions)?;
        hook_hints(&mut unicorn, image, &notes)?;
        let seen = notes.clone();
        unicorn.add_mem_hook(HookType::MEM_INVALID, 0, u64::MAX, move |_, _, address, _, _| {
            seen.borrow_mut().bad_address = Some(address as u32);
            false
        })?;
        let mut cpu = Self {
            unicorn,
            bus: bus.clone(),
            notes,
            floats: Vec::new(),
            is_asleep: false,
            last_fault: None,
        };
        let (stack, start) = (cpu.word(chip::FLASH), cpu.word(chip::FLASH + 4));
        cpu.set(RegisterARM::SP, stack);
        cpu.set(RegisterARM::LR, u32::MAX);
        cpu.set(RegisterARM::PC, start);
        Ok(cpu)
    }

    fn get(&self, register: RegisterARM) -> u32 {
        // Every register that is named here exists.
        self.unicorn.reg_read(register).unwrap_or_default() as u32
    }

    fn set(&mut self, register: RegisterARM, value: u32) {
        let _ = self.unicorn.reg_write(register, u64::from(value));
    }

    fn word(&self, address: u32) -> u32 {
        let mut bytes = [0; 4];
        let _ = self.unicorn.mem_read(u64::from(address), &mut bytes);
        u32::from_le_bytes(bytes)
    }

    /// What the board's memories hold.
    pub(crate) fn memories(&self, board: &Board) -> Vec<Vec<u8>> {
        let read = |&(address, length): &(u32, u32)| self.unicorn.mem_read_as_vec(u64::from(address), length as usize);
        board.memories.iter().map(|memory| read(memory).unwrap_or_default()).collect()
    }

    /// The instruction that is next, or the block that runs.
    pub(crate) fn block(&self) -> u32 {
        self.notes.borrow().block
    }

    /// Lets the peripherals do what is due.
    pub(crate) fn advance(&mut self) {
        self.bus.borrow_mut().advance(&mut Ram(&mut self.unicorn));
    }

    /// Takes the most urgent interrupt that may be taken. True if one was.
    pub(crate) fn take_interrupt(&mut self) -> bool {
        if !self.bus.borrow().core.is_waiting {
            return false;
        }
        let next = self.bus.borrow().core.next();
        // What is pending wakes a sleeping processor, also if it is masked.
        self.is_asleep &= next.is_none();
        let masked = self.get(RegisterARM::PRIMASK) | self.get(RegisterARM::FAULTMASK);
        match next {
            Some(exception) if masked & 1 == 0 => {
                self.enter(exception);
                true
            }
            _ => false,
        }
    }

    /// Enters an exception's handler.
    pub(crate) fn enter(&mut self, exception: usize) {
        let float = self.get(RegisterARM::CONTROL) & 4 != 0;
        let kept = float.then(|| {
            let read = |register| self.unicorn.reg_read(register).unwrap_or_default();
            (FLOATS.map(read).to_vec(), read(RegisterARM::FPSCR))
        });
        self.floats.push(kept);
        let stack = self.get(RegisterARM::SP);
        let frame = (stack - 32) & !7;
        /// Of xPSR: Thumb, and that the stack was moved by a word.
        const THUMB: u32 = 1 << 24;
        let moved = if frame == stack - 32 { 0 } else { 1 << 9 };
        let outer = self.bus.borrow().core.active.last().map_or(0, |&number| number as u32);
        let status = self.get(RegisterARM::XPSR) & 0xf80f_0000 | THUMB | moved | outer;
        let [r0, r1, r2, r3, r12] = GENERAL.map(|register| self.get(register));
        let words = [r0, r1, r2, r3, r12, self.get(RegisterARM::LR), self.get(RegisterARM::PC), status];
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        let _ = self.unicorn.mem_write(u64::from(frame), &bytes);
        self.set(RegisterARM::SP, frame);
        self.set(RegisterARM::LR, RETURN);
        let vector = self.bus.borrow_mut().core.enter(exception);
        let handler = self.word(vector);
        self.set(RegisterARM::PC, handler);
        self.notes.borrow_mut().event = true;
        self.is_asleep = false;
    }

    /// Goes on elsewhere.
    pub(crate) fn jump(&mut self, address: u32) {
        self.set(RegisterARM::PC, address | 1);
        self.is_asleep = false;
    }

    /// Returns from a handler.
    fn leave(&mut self) {
        let frame = self.get(RegisterARM::SP);
        let words: [u32; 8] = std::array::from_fn(|nth| self.word(frame + 4 * nth as u32));
        let [r0, r1, r2, r3, r12, link, next, status] = words;
        for (register, value) in GENERAL.into_iter().zip([r0, r1, r2, r3, r12]) {
            self.set(register, value);
        }
        self.set(RegisterARM::LR, link);
        self.set(RegisterARM::SP, frame + 32 + if status >> 9 & 1 != 0 { 4 } else { 0 });
        self.set(RegisterARM::APSR_NZCVQG, status & 0xf80f_0000);
        if let Some((registers, status)) = self.floats.pop().flatten() {
            for (register, value) in FLOATS.into_iter().zip(registers) {
                let _ = self.unicorn.reg_write(register, value);
            }
            let _ = self.unicorn.reg_write(RegisterARM::FPSCR, status);
        }
        self.set(RegisterARM::FAULTMASK, 0);
        self.set(RegisterARM::PC, next | 1);
        let mut bus = self.bus.borrow_mut();
        bus.core.active.pop();
    }

    /// Executes instructions until something is due. An error says what stopped the processor for good.
    pub(crate) fn execute(&mut self) -> Result<(), String> {
        let from = u64::from(self.get(RegisterARM::PC) | 1);
        let result = self.unicorn.emu_start(from, u64::from(RETURN & !1), 0, 0);
        let bad_address = self.notes.borrow_mut().bad_address.take();
        let bus_fault = self.bus.borrow_mut().bus_fault.take();
        match result {
            _ if bus_fault.is_some() => self.fault(BAD_DATA, bus_fault),
            // The architecture lets nobody execute there: Unicorn calls it an exception.
            _ if self.get(RegisterARM::PC) == RETURN & !1 => {
                self.leave();
                Ok(())
            }
            Ok(()) => {
                let mut notes = self.notes.borrow_mut();
                if std::mem::take(&mut notes.sleeps) && !std::mem::take(&mut notes.event) {
                    self.is_asleep = true;
                }
                Ok(())
            }
            Err(uc_error::INSN_INVALID | uc_error::EXCEPTION) => self.fault(UNDEFINED, None),
            Err(uc_error::FETCH_UNMAPPED | uc_error::FETCH_PROT) => self.fault(BAD_FETCH, None),
            Err(_) if bad_address.is_some() => self.fault(BAD_DATA, bad_address),
            Err(error) => Err(format!("the processor stopped: {error:?}")),
        }
    }

    /// Takes a hard fault, which all faults become here.
    fn fault(&mut self, status: u32, address: Option<u32>) -> Result<(), String> {
        if self.bus.borrow().core.active.contains(&HARD_FAULT) {
            return Err("a fault in the handler of faults".to_owned());
        }
        self.last_fault = Some((self.get(RegisterARM::PC), address));
        self.bus.borrow_mut().core.note_fault(status, address);
        self.enter(HARD_FAULT);
        Ok(())
    }
}

fn map(
    unicorn: &mut Unicorn<'static, ()>,
    board: &Board,
    image: &Image,
    memories: &[Vec<u8>],
    bus: &Shared,
) -> Result<(), uc_error> {
    unicorn.mem_map(u64::from(chip::FLASH), u64::from(chip::PROGRAM_BYTES), Prot::READ | Prot::EXEC)?;
    for (address, bytes) in &image.segments {
        unicorn.mem_write(u64::from(*address), bytes)?;
    }
    for (&(address, length), bytes) in board.memories.iter().zip(memories) {
        unicorn.mem_map(u64::from(address), u64::from(length), Prot::ALL)?;
        unicorn.mem_write(u64::from(address), bytes)?;
    }
    let (settings, sector) = board.settings;
    let regions = [
        (settings, 2 * sector),
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
            Some(move |_: &mut Unicorn<'_, ()>, offset: u64, size: usize, value: u64| {
                writes.borrow_mut().write(base + offset as u32, size, value);
            }),
        )?;
    }
    Ok(())
}

fn hook_blocks(
    unicorn: &mut Unicorn<'static, ()>,
    bus: &Shared,
    notes: &Rc<RefCell<Notes>>,
    instructions: &Rc<RefCell<u64>>,
) -> Result<(), uc_error> {
    let (bus, notes, total) = (bus.clone(), notes.clone(), instructions.clone());
    let mut known = HashMap::new();
    unicorn.add_block_hook(1, 0, move |unicorn, address, size| {
        let address = address as u32;
        let mut count = |address, size| {
            *known.entry((address, size)).or_insert_with(|| count(unicorn, address, size))
        };
        let mut bus = bus.borrow_mut();
        let mut notes = notes.borrow_mut();
        if let Some((address, size)) = notes.begin(address, size) {
            let undone = count(address, size);
            bus.now -= u64::from(undone) * bus.instruction;
            *total.borrow_mut() -= u64::from(undone);
        }
        if notes.poll(address, bus.accesses) > POLLS_MAX {
            bus.now = bus.now.max(bus.deadline);
        }
        let unmasked = || unicorn.reg_read(RegisterARM::PRIMASK).is_ok_and(|masked| masked == 0);
        if bus.now >= bus.deadline || bus.core.is_waiting && bus.core.next().is_some() && unmasked() {
            // What is not executed is not cut out of.
            notes.bytes = 0;
            let _ = unicorn.emu_stop();
            return;
        }
        let count = count(address, size);
        bus.now += u64::from(count) * bus.instruction;
        *total.borrow_mut() += u64::from(count);
    })?;
    Ok(())
}

/// Instructions of a block: one of 32 bits begins with 0b11101, 0b11110 or 0b11111.
fn count(unicorn: &Unicorn<'_, ()>, address: u32, size: u32) -> u32 {
    let bytes = unicorn.mem_read_as_vec(u64::from(address), size as usize).unwrap_or_default();
    let (mut at, mut count) = (0, 0);
    while let Some(&high) = bytes.get(at + 1) {
        at += if high >> 3 >= 0b11101 { 4 } else { 2 };
        count += 1;
    }
    count
}

/// Hooks WFE, WFI and SEV, which Unicorn takes for nothing or for an end. Where the same bits are no instruction, a hook is never called.
fn hook_hints(
    unicorn: &mut Unicorn<'static, ()>,
    image: &Image,
    notes: &Rc<RefCell<Notes>>,
) -> Result<(), uc_error> {
    for (base, bytes) in &image.segments {
        for (nth, pair) in bytes.chunks_exact(2).enumerate() {
            let address = u64::from(base + 2 * nth as u32);
            let notes = notes.clone();
            match pair {
                [0x40, 0xbf] => {
                    unicorn.add_code_hook(address, address, move |_, _, _| notes.borrow_mut().event = true)?;
                }
                [0x20 | 0x30, 0xbf] => {
                    unicorn.add_code_hook(address, address, move |unicorn, address, _| {
                        notes.borrow_mut().sleeps = true;
                        let _ = unicorn.reg_write(RegisterARM::PC, address + 2 | 1);
                        let _ = unicorn.emu_stop();
                    })?;
                }
                _ => {}
            }
        }
    }
    Ok(())
}
