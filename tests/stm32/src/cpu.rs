//! The processor: Unicorn executes instructions; exceptions, sleeping and time are done here.
//!
//! Unicorn calls back before each block of instructions. Its instructions are counted as time then, and if something is due
//! or an interrupt may be taken, Unicorn is stopped between two blocks. An exception's frame lies on the program's
//! stack as the architecture says (ARMv7-M, B1.5.6); registers of the floating-point unit are kept here instead.

use std::cell::RefCell;
use std::rc::Rc;

use unicorn_engine::{Arch, ArmCpuModel, Mode, RegisterARM, Unicorn, uc_error};

use crate::bus::Memory;
use crate::chip::{self, Board};
use crate::core::HARD_FAULT;
use crate::hooks::{self, Notes, Shared};
use crate::work::Work;

/// The value of LR that a handler returns to.
const RETURN: u32 = 0xffff_fff9;
/// CFSR.UNDEFINSTR, PRECISERR, IBUSERR.
const UNDEFINED: u32 = 1 << 16;
const BAD_DATA: u32 = 1 << 9;
const BAD_FETCH: u32 = 1 << 8;

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
        memories: &[Vec<u8>],
        bus: &Shared,
        work: &Rc<RefCell<Work>>,
    ) -> Result<Self, uc_error> {
        let mut unicorn = Unicorn::new(Arch::ARM, Mode::THUMB)?;
        unicorn.ctl_set_cpu_model(ArmCpuModel::CORTEX_M7 as i32)?;
        hooks::map(&mut unicorn, board, memories, bus)?;
        let notes = Rc::new(RefCell::new(Notes::default()));
        hooks::hook_blocks(&mut unicorn, bus, &notes, work)?;
        hooks::hook_faults(&mut unicorn, board, &notes)?;
        let mut cpu =
            Self { unicorn, bus: bus.clone(), notes, floats: Vec::new(), is_asleep: false, last_fault: None };
        let (stack, start) = (cpu.word(chip::FLASH), cpu.word(chip::FLASH + 4));
        cpu.set(RegisterARM::SP, stack);
        cpu.set(RegisterARM::LR, u32::MAX);
        cpu.set(RegisterARM::PC, start);
        Ok(cpu)
    }

    /// The boot loader has handed over to the program `active`.
    pub(crate) fn hand_over(&mut self, (base, length): (u32, u32)) {
        let code = self.bus.borrow().flash.cells.read(base, length as usize).to_vec();
        // As many hooks as there are such instructions.
        let _ = hooks::hook_hints(&mut self.unicorn, base, &code, &self.notes);
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
        let read = |&(address, length): &(u32, u32)| {
            self.unicorn.mem_read_as_vec(u64::from(address), length as usize)
        };
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
