//! The processor's own peripherals: NVIC, SCB, DWT, MPU (ARMv7-M architecture, B3). Unicorn has none of them.

use crate::bank::{ALL, Bank};
use crate::caches::Caches;
use crate::time::{SECOND, Time};

/// Interrupts that a chip may have.
const INTERRUPTS: usize = 160;
/// Exceptions before the first interrupt.
pub(crate) const FIRST_INTERRUPT: usize = 16;
/// The exception's number of a hard fault.
pub(crate) const HARD_FAULT: usize = 3;

const ICSR: u32 = 0xed04;
const VTOR: u32 = 0xed08;
const AIRCR: u32 = 0xed0c;
const CCR: u32 = 0xed14;
const CFSR: u32 = 0xed28;
const BFAR: u32 = 0xed38;
const CYCCNT: u32 = 0x1004;
/// Empties the instruction cache.
const ICIALLU: u32 = 0xef50;

/// The core's registers and the state of its interrupts.
pub(crate) struct Core {
    registers: Bank,
    pub(crate) caches: Caches,
    enabled: [bool; INTERRUPTS],
    pending: [bool; INTERRUPTS],
    priority: [u8; INTERRUPTS],
    /// Exceptions being served, the innermost last.
    pub(crate) active: Vec<usize>,
    /// The program asked for a reset.
    pub(crate) reset_requested: bool,
    /// The boot loader has set the program's vector table.
    pub(crate) handed_over: bool,
    /// Anything is pending and enabled.
    pub(crate) is_waiting: bool,
}

impl Core {
    pub(crate) fn new() -> Self {
        let mut rows = vec![
            // ITM, DWT, SysTick.
            (0x1000, 0x4000_0000, ALL),
            (0xe010, 0, ALL),
            (0xe014, 0, ALL),
            (0xe018, 0, ALL),
            (VTOR, crate::chip::FLASH, ALL),
            (CFSR, 0, ALL),
            // HFSR, MMFAR, BFAR.
            (0xed2c, 0, ALL),
            (0xed34, 0, ALL),
            (BFAR, 0, ALL),
        ];
        // SCR, CCR, priorities of system handlers, SHCSR; CPACR, DEMCR.
        rows.extend([0xed10, CCR, 0xed18, 0xed1c, 0xed20, 0xed24, 0xed88, 0xedfc].map(|at| (at, 0, ALL)));
        // FPCCR, FPCAR, FPDSCR.
        rows.extend([0xef34, 0xef38, 0xef3c].map(|at| (at, 0, ALL)));
        Self {
            registers: Bank::new(&rows),
            caches: Caches::default(),
            enabled: [false; INTERRUPTS],
            pending: [false; INTERRUPTS],
            priority: [0; INTERRUPTS],
            active: Vec::new(),
            reset_requested: false,
            handed_over: false,
            is_waiting: false,
        }
    }

    pub(crate) fn read(&mut self, offset: u32, bytes: usize, now: Time, core_hz: u64) -> Option<u32> {
        let set = |flags: &[bool; INTERRUPTS], at: u32| {
            let first = (at / 4 * 32) as usize;
            (0..32).filter(|bit| flags[first + bit]).fold(0, |word, bit| word | 1 << bit)
        };
        Some(match offset {
            0xe100..0xe114 => set(&self.enabled, offset - 0xe100),
            0xe180..0xe194 => set(&self.enabled, offset - 0xe180),
            0xe200..0xe214 => set(&self.pending, offset - 0xe200),
            0xe280..0xe294 => set(&self.pending, offset - 0xe280),
            0xe400..0xe4a0 => {
                let first = (offset - 0xe400) as usize;
                (0..bytes).rev().fold(0, |word, at| word << 8 | u32::from(self.priority[first + at]))
            }
            ICSR => self.active.last().map_or(0, |&number| number as u32) | u32::from(self.is_waiting) << 22,
            AIRCR => 0xfa05_0000,
            CYCCNT => (u128::from(now) * u128::from(core_hz) / u128::from(SECOND)) as u32,
            0xed90..0xedbc => self.caches.read_mpu(offset)?,
            // CPUID.
            0xed00 => 0x411f_c271,
            _ => self.registers.read(offset)?,
        })
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32, bytes: usize) -> Option<()> {
        let change = |flags: &mut [bool; INTERRUPTS], at: u32, to: bool| {
            let first = (at / 4 * 32) as usize;
            (0..32).filter(|bit| value >> bit & 1 != 0).for_each(|bit| flags[first + bit] = to);
        };
        match offset {
            0xe100..0xe114 => change(&mut self.enabled, offset - 0xe100, true),
            0xe180..0xe194 => change(&mut self.enabled, offset - 0xe180, false),
            // Interrupts that no chip has: writes are ignored (B3.4.5).
            0xe194..0xe1c0 => {}
            0xe200..0xe214 => change(&mut self.pending, offset - 0xe200, true),
            0xe280..0xe294 => change(&mut self.pending, offset - 0xe280, false),
            0xe400..0xe4a0 => {
                let first = (offset - 0xe400) as usize;
                // Four bits count.
                (0..bytes).for_each(|at| self.priority[first + at] = (value >> (8 * at)) as u8 & 0xf0);
            }
            AIRCR => self.reset_requested |= value & 4 != 0,
            CYCCNT | ICSR => {}
            ICIALLU => self.caches.empty(),
            0xed90..0xedbc => self.caches.write_mpu(offset, value)?,
            CCR => {
                self.caches.control(value);
                self.registers.set(CCR, value);
            }
            // Flags are cleared by ones.
            CFSR | 0xed2c => self.registers.set(offset, self.registers.get(offset) & !value),
            _ => {
                self.handed_over |= offset == VTOR;
                self.registers.write(offset, value)?;
            }
        }
        self.look();
        Some(())
    }

    fn look(&mut self) {
        self.is_waiting = (0..INTERRUPTS).any(|number| self.enabled[number] && self.pending[number]);
    }

    /// Makes interrupt `number` pending.
    pub(crate) fn pend(&mut self, number: usize) {
        self.pending[number] = true;
        self.is_waiting |= self.enabled[number];
    }

    /// The most urgent interrupt that may be taken, as an exception's number.
    pub(crate) fn next(&self) -> Option<usize> {
        let running = self.active.iter().map(|&number| self.priority_of(number)).min().unwrap_or(i16::MAX);
        let waiting = (0..INTERRUPTS).filter(|&number| self.enabled[number] && self.pending[number]);
        let next =
            waiting.map(|number| FIRST_INTERRUPT + number).min_by_key(|&number| self.priority_of(number))?;
        (self.priority_of(next) < running).then_some(next)
    }

    fn priority_of(&self, exception: usize) -> i16 {
        match exception.checked_sub(FIRST_INTERRUPT) {
            Some(interrupt) => i16::from(self.priority[interrupt]),
            // The NMI is above hard faults.
            None if exception == 2 => -2,
            None if exception == HARD_FAULT => -1,
            None => 0,
        }
    }

    /// Exception `number` is served from now on; its handler's address is in the table that this returns the address of.
    pub(crate) fn enter(&mut self, number: usize) -> u32 {
        if let Some(interrupt) = number.checked_sub(FIRST_INTERRUPT) {
            self.pending[interrupt] = false;
            self.look();
        }
        self.active.push(number);
        self.registers.get(VTOR) + 4 * number as u32
    }

    /// A peripheral holds interrupt `number` up, or not. One that is being served is looked at again afterwards.
    pub(crate) fn raise(&mut self, number: usize, on: bool) {
        if on && !self.active.contains(&(FIRST_INTERRUPT + number)) {
            self.pend(number);
        }
    }

    /// Whether bus faults are ignored in a handler that masks all but NMI (CCR.BFHFNMIGN).
    pub(crate) fn ignores_bus_faults(&self) -> bool {
        self.registers.get(CCR) & 1 << 8 != 0
    }

    /// Notes why a fault is taken: bits of CFSR, and the address of a failed access.
    pub(crate) fn note_fault(&mut self, status: u32, address: Option<u32>) {
        /// CFSR.BFARVALID.
        const ADDRESS_VALID: u32 = 1 << 15;
        let valid = if address.is_some() { ADDRESS_VALID } else { 0 };
        self.registers.set(CFSR, self.registers.get(CFSR) | status | valid);
        self.registers.set(BFAR, address.unwrap_or_default());
    }
}
