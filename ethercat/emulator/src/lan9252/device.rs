//! The system registers.

use super::conditions::{SpiFaults, Timing, Traffic};
use super::csr::Csr;
use super::fifo::{Fifo, or_nothing};
use crate::{Nanos, SharedChip};
use mobgate_world::random::Random;

const TEST_PATTERN: u32 = 0x8765_4321;
const IDENTITY: u32 = 0x9252_0001;
const READY: u32 = 1 << 27;
const STATUS_READY: u32 = 1 << 30;
const IRQ_ENABLE: u32 = 1 << 8;
const IRQ_ACTIVE_HIGH: u32 = 1 << 4;
const IRQ_PUSH_PULL: u32 = 1;
const RESET_DIGITAL: u32 = 1;
const RESET_ETHERCAT: u32 = 1 << 6;

/// Everything behind the SPI.
pub(super) struct Device {
    pub(super) chip: SharedChip,
    pub(super) timing: Timing,
    pub(super) faults: SpiFaults,
    pub(super) random: Random,
    pub(super) injected: u64,
    pub(super) traffic: Traffic,
    pub(super) violations: Vec<String>,
    /// A fault was injected: apparent misuse may not be the driver's.
    pub(super) tainted: bool,
    pub(super) csr: Csr,
    pub(super) read: Fifo,
    pub(super) write: Fifo,
    irq_config: u32,
    irq_enable: u32,
    /// The board has a pull-up at the interrupt pin instead of a pull-down.
    pub(super) pulled_up: bool,
    /// When it was last reset.
    reset_at: Nanos,
}

impl Device {
    pub(super) fn new(chip: SharedChip, timing: Timing, at: Nanos) -> Self {
        Self {
            chip,
            timing,
            faults: SpiFaults::default(),
            random: Random::new(0),
            injected: 0,
            traffic: Traffic::default(),
            violations: Vec::new(),
            tainted: false,
            csr: Csr::default(),
            read: Fifo::default(),
            write: Fifo::default(),
            irq_config: 0,
            irq_enable: 0,
            pulled_up: false,
            reset_at: at,
        }
    }

    /// Resets everything, the ESC included.
    pub(super) fn reset(&mut self, at: Nanos) {
        self.chip.borrow_mut().reset();
        (self.csr, self.read, self.write) = Default::default();
        (self.irq_config, self.irq_enable) = (0, 0);
        self.reset_at = at;
    }

    pub(super) fn violation(&mut self, at: Nanos, what: &str) {
        if !self.tainted {
            self.violations.push(format!("at {at} ns: {what}"));
        }
    }

    /// The level of the interrupt pin. As an open drain, its reset state, it can only pull down; otherwise the board's resistor
    /// decides.
    pub(super) fn pin(&mut self, at: Nanos) -> bool {
        let requested = self.irq_config & IRQ_ENABLE != 0 && self.interrupts(at) & self.irq_enable != 0;
        match self.irq_config & IRQ_PUSH_PULL {
            0 => self.pulled_up && !requested,
            _ => requested == (self.irq_config & IRQ_ACTIVE_HIGH != 0),
        }
    }

    fn interrupts(&mut self, at: Nanos) -> u32 {
        let ready = if self.is_ready(at) { STATUS_READY } else { 0 };
        ready | u32::from(self.chip.borrow_mut().interrupt(at))
    }

    fn responds(&self, at: Nanos) -> bool {
        at >= self.reset_at + self.timing.test_nanos
    }

    fn is_ready(&self, at: Nanos) -> bool {
        at >= self.reset_at + self.timing.ready_nanos
    }

    /// Advances the engines to `at`.
    pub(super) fn run(&mut self, at: Nanos) {
        let chip = &mut self.chip.borrow_mut();
        self.read.fill(chip, at, self.timing.fifo_nanos);
        self.write.drain(chip, at, self.timing.fifo_nanos);
    }

    /// Flushes what the driver has pushed to memory, even if it never accesses the chip again.
    pub(super) fn settle(&mut self) {
        self.write.settle(&mut self.chip.borrow_mut());
    }

    /// Reads a register. During reset the bus floats.
    pub(super) fn read_register(&mut self, address: u16, at: Nanos) -> u32 {
        self.run(at);
        if !self.responds(at) {
            return u32::MAX;
        }
        match address {
            0x000..=0x01C => {
                let (word, outcome) = or_nothing(self.read.pop());
                self.judge(outcome, at);
                word
            }
            0x050 => IDENTITY,
            0x054 => self.irq_config,
            0x058 => self.interrupts(at),
            0x05C => self.irq_enable,
            0x064 => TEST_PATTERN,
            0x074 => u32::from(self.is_ready(at)) * READY,
            0x1F8 => 0,
            0x300 => self.csr.data(at),
            0x304 => self.csr.command(at),
            0x308 => self.read.place(),
            0x30C => self.read.waiting(),
            0x310 => self.write.place(),
            0x314 => self.write.room(),
            _ => {
                self.violation(at, &format!("read of register {address:#05x}, which is not there"));
                0
            }
        }
    }

    /// Writes a register; ignored during reset.
    pub(super) fn write_register(&mut self, address: u16, value: u32, at: Nanos) {
        self.run(at);
        if !self.responds(at) {
            return;
        }
        let outcome = match address {
            0x020..=0x03C => self.write.push(value),
            0x054 => {
                self.irq_config = value;
                Ok(())
            }
            0x05C => {
                self.irq_enable = value;
                Ok(())
            }
            0x1F8 if value & (RESET_DIGITAL | RESET_ETHERCAT) != 0 => {
                self.reset(at);
                Ok(())
            }
            0x300 => self.csr.set_data(value, at),
            0x304 => {
                let starts = (self.reset_at + self.timing.ready_nanos).saturating_sub(at);
                self.csr.start(value, &mut self.chip.borrow_mut(), at, starts + self.timing.csr_nanos)
            }
            0x308 => self.read.set_place(value),
            0x30C => self.read.command(value, &self.write, at),
            0x310 => self.write.set_place(value),
            0x314 => self.write.command(value, &self.read, at),
            _ => Err("write to a register that is not there"),
        };
        self.judge(outcome, at);
    }

    fn judge(&mut self, outcome: Result<(), &'static str>, at: Nanos) {
        if let Err(what) = outcome {
            self.violation(at, what);
        }
    }
}
