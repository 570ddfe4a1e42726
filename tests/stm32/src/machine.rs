//! A board with its image: power, time, and what a person or a device at its connectors sees.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::time::Duration;

use crate::bus::Bus;
use crate::cells::Cells;
use crate::chip::{Board, Family};
use crate::cpu::Cpu;
use crate::hooks::Shared;
use crate::image::Image;
use crate::phy::Phy;
use crate::rcc::Reset;
use crate::time::{self, Time};
use crate::work::Work;

/// Why a run stopped before its time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stop {
    /// Something that no model knows, or that the chip forbids.
    Fault(String),
    /// The power was cut, as the test wanted.
    PowerCut,
}

impl std::fmt::Display for Stop {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Fault(what) => f.write_str(what),
            Self::PowerCut => f.write_str("the power was cut"),
        }
    }
}

/// A board.
pub struct Machine {
    pub(crate) board: Board,
    pub(crate) image: Image,
    pub(crate) bus: Shared,
    pub(crate) cpu: Cpu,
    work: Rc<RefCell<Work>>,
    /// Why it was reset, each time.
    pub resets: Vec<Reset>,
    /// Where the program was at each fault, and what it touched.
    pub faults: Vec<String>,
}

impl Machine {
    /// A board that was just given power, with erased settings and a cable in its Ethernet socket.
    pub fn new(board: Board) -> Result<Self, String> {
        Self::with_phy(board, true)
    }

    /// The same, the PHY of which does not respond and gives no clock.
    pub fn without_phy(board: Board) -> Result<Self, String> {
        Self::with_phy(board, false)
    }

    fn with_phy(board: Board, is_there: bool) -> Result<Self, String> {
        let image = Image::of_board(&board)?;
        let mut cells = Cells::new();
        image.segments.iter().for_each(|(address, bytes)| cells.put(*address, bytes));
        let bus = Rc::new(RefCell::new(Bus::new(board, Phy::new(is_there), cells)));
        let work = Rc::default();
        let cpu = Cpu::new(&board, &random(&board), &bus, &work).map_err(|error| format!("{error:?}"))?;
        Ok(Self { board, image, bus, cpu, work, resets: Vec::new(), faults: Vec::new() })
    }

    /// The family of its chip.
    pub fn family(&self) -> Family {
        self.board.family
    }

    /// Bytes of the program that was built.
    pub(crate) fn program_bytes(&self) -> usize {
        (self.image.end(self.board.active) - self.board.active.0) as usize
    }

    /// Time since the first power-up.
    pub fn now(&self) -> Duration {
        time::duration(self.bus.borrow().now)
    }

    /// Instructions executed since the first power-up.
    pub fn instructions(&self) -> u64 {
        self.work.borrow().total
    }

    /// The functions that executed most instructions since this was last asked, and how many.
    pub fn busiest(&mut self) -> Vec<(i64, String)> {
        let mut functions = BTreeMap::<_, i64>::new();
        for (address, executed) in self.work.borrow_mut().take() {
            *functions.entry(self.image.function(address).to_owned()).or_default() += executed;
        }
        let mut functions: Vec<_> = functions.into_iter().map(|(name, executed)| (executed, name)).collect();
        functions.sort_by_key(|(executed, _)| std::cmp::Reverse(*executed));
        functions
    }

    /// Bytes of the stack's memory that hold what they did when the power came, and all of them. Before a reset.
    pub fn stack_free(&self) -> (usize, usize) {
        let (end, start) = self.image.stack;
        let (before, now) = (random(&self.board), self.cpu.memories(&self.board));
        for (&(base, length), (before, now)) in self.board.memories.iter().zip(before.iter().zip(&now)) {
            if (base..base + length).contains(&end) {
                let stack = (end - base) as usize..(start - base) as usize;
                let pairs = before[stack.clone()].iter().zip(&now[stack.clone()]);
                return (pairs.take_while(|(before, now)| before == now).count(), stack.len());
            }
        }
        (0, 0)
    }

    /// Runs for so long.
    pub fn run(&mut self, time: Duration) -> Result<(), Stop> {
        let end = self.bus.borrow().now + time::span(time);
        self.run_until(end)
    }

    pub(crate) fn run_until(&mut self, end: Time) -> Result<(), Stop> {
        loop {
            self.cpu.advance();
            self.check()?;
            let now = self.bus.borrow().now;
            if now >= end {
                return Ok(());
            }
            let stalled_until = self.bus.borrow().stalled_until;
            if stalled_until <= now && self.cpu.take_interrupt() {
                continue;
            }
            let mut bus = self.bus.borrow_mut();
            let next = bus.next_event().min(end);
            if stalled_until > now {
                bus.now = next.max(now + 1).min(stalled_until);
            } else if self.cpu.is_asleep {
                bus.now = next.max(now + 1);
            } else {
                bus.deadline = next;
                drop(bus);
                let result = self.cpu.execute();
                result.map_err(|what| Stop::Fault(format!("{what} {}", self.place())))?;
                if let Some((at, touched)) = self.cpu.last_fault.take() {
                    let touched =
                        touched.map_or_else(String::new, |address| format!(", by access to {address:#010x}"));
                    self.faults.push(format!("at {at:#010x} of {}{touched}", self.image.function(at)));
                }
            }
        }
    }

    /// Stops where a model does not know, and resets where the chip does.
    fn check(&mut self) -> Result<(), Stop> {
        let mut bus = self.bus.borrow_mut();
        if let Some(complaint) = bus.complaint.take() {
            drop(bus);
            return Err(Stop::Fault(format!("the program {complaint} {}", self.place())));
        }
        if let Some(rule) = bus.flash.cells.broken_rule.take() {
            drop(bus);
            return Err(Stop::Fault(format!("{rule} {}", self.place())));
        }
        if std::mem::take(&mut bus.flash.cells.is_cut) {
            return Err(Stop::PowerCut);
        }
        let now = bus.now;
        let watchdog = bus.watchdog.next_event().is_some_and(|at| at <= now);
        let requested = bus.core.reset_requested;
        let handed_over = std::mem::take(&mut bus.core.handed_over);
        let (active, bytes) = self.board.active;
        let is_torn = bus.flash.cells.is_torn_within(active..active + bytes);
        drop(bus);
        if handed_over {
            if is_torn {
                return Err(Stop::Fault(
                    "the boot loader starts an image with a word that is torn".to_owned(),
                ));
            }
            self.cpu.hand_over(self.board.active);
        }
        if watchdog || requested {
            self.reset(if watchdog { Reset::Watchdog } else { Reset::Software });
        }
        Ok(())
    }

    /// Where the program is.
    pub fn place(&self) -> String {
        let block = self.cpu.block();
        let faults = if self.faults.is_empty() {
            String::new()
        } else {
            format!(" and the faults {:?}", &self.faults[..self.faults.len().min(3)])
        };
        let (function, now, resets) =
            (self.image.function(block), self.now(), &self.resets[..self.resets.len().min(3)]);
        format!("in the block at {block:#010x} of {function}, after {now:?}, the resets {resets:?}{faults}")
    }

    /// Resets the chip. Memories keep what they hold, but for a loss of power.
    pub(crate) fn reset(&mut self, cause: Reset) {
        let memories =
            if cause == Reset::Power { random(&self.board) } else { self.cpu.memories(&self.board) };
        self.resets.push(cause);
        self.bus.borrow_mut().reset(cause);
        // It has been made in the same way before.
        if let Ok(cpu) = Cpu::new(&self.board, &memories, &self.bus, &self.work) {
            self.cpu = cpu;
        }
    }

    /// Takes the power away and gives it back.
    pub fn power_cycle(&mut self) {
        self.reset(Reset::Power);
    }
}

/// What memories hold after the power came: anything.
fn random(board: &Board) -> Vec<Vec<u8>> {
    let mut state = 0x2545_f491_4f6c_dd1d_u64;
    let mut byte = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state as u8
    };
    board.memories.iter().map(|&(_, length)| (0..length).map(|_| byte()).collect()).collect()
}
