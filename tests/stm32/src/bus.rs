//! What the processor is connected to: the peripherals' models by their addresses, their interrupts, DMA, and the one clock.

use std::cell::Cell;
use std::collections::{BTreeMap, VecDeque};

use crate::bank::{ALL, Bank};
use crate::caches::Caches;
use crate::cells::Cells;
use crate::chip::{self, Board, Family, UARTS};
use crate::core::Core;
use crate::dma::{Dma, Item, Request};
use crate::ethernet::Ethernet;
use crate::exti::Exti;
use crate::flash::Flash;
use crate::gpio::{Drive, Gpio, REFERENCE_CLOCK, SPI_INTERRUPT};
use crate::phy::Phy;
use crate::random::Random;
use crate::rcc::{Clocks, Rcc, Reset};
use crate::spi::{Spi, Target};
use crate::time::{NANOSECOND, SECOND, Time};
use crate::timer::Timer;
use crate::usart::Usart;
use crate::watchdog::Watchdog;

/// Where SPI1 is.
pub(crate) const SPI_BASE: u32 = 0x4001_3000;

/// How long a character that DMA has read from a UART is on its way to memory, over the bridges between the H7's domains; shorter
/// elsewhere. The stream's counter does not wait for that.
const DMA_STORES: Time = 100 * NANOSECOND;

/// Memory as DMA sees it.
pub(crate) trait Memory {
    fn load(&self, address: u32, bytes: &mut [u8]);
    fn store(&mut self, address: u32, bytes: &[u8]);
}

/// Memory with a look at what the data cache may hold of it.
struct Watched<'m, M> {
    memory: &'m mut M,
    caches: Caches,
    /// An address that DMA has accessed there.
    held: Cell<Option<u32>>,
}

impl<M> Watched<'_, M> {
    fn look(&self, address: u32, length: usize) {
        let ends = [address, (address + length as u32).saturating_sub(1)];
        if let Some(held) = ends.into_iter().find(|&address| self.caches.holds(address)) {
            self.held.set(Some(held));
        }
    }
}

impl<M: Memory> Memory for Watched<'_, M> {
    fn load(&self, address: u32, bytes: &mut [u8]) {
        self.look(address, bytes.len());
        self.memory.load(address, bytes);
    }

    fn store(&mut self, address: u32, bytes: &[u8]) {
        self.look(address, bytes.len());
        self.memory.store(address, bytes);
    }
}

/// All peripherals.
pub(crate) struct Bus {
    pub(crate) board: Board,
    pub(crate) now: Time,
    /// When the processor has to be interrupted for what happens then.
    pub(crate) deadline: Time,
    /// The time of one instruction.
    pub(crate) instruction: Time,
    pub(crate) clocks: Clocks,
    pub(crate) core: Core,
    pub(crate) rcc: Rcc,
    pub(crate) flash: Flash,
    pub(crate) gpio: Gpio,
    pub(crate) timer: Timer,
    pub(crate) random: Random,
    pub(crate) watchdog: Watchdog,
    pub(crate) uarts: [Usart; 5],
    pub(crate) dma: Dma,
    /// Characters on their way to memory: when they are there, address, value.
    stored: VecDeque<(Time, u32, u8)>,
    pub(crate) spi: Spi,
    pub(crate) ethernet: Ethernet,
    pub(crate) pwr: Bank,
    pub(crate) syscfg: Bank,
    pub(crate) exti: Exti,
    /// What is at the SPI.
    pub(crate) target: Option<Box<dyn Target>>,
    pub(crate) axi: Bank,
    /// The chip's.
    pub(crate) revision: u16,
    /// Reads and writes of the program's, of all peripherals.
    pub(crate) accesses: (u64, u64),
    /// The program has just read that the flash is busy.
    pub(crate) waits_for_flash: bool,
    /// The processor stands still until then.
    pub(crate) stalled_until: Time,
    /// A bus fault at this address.
    pub(crate) bus_fault: Option<u32>,
    /// What the program does that no model knows, or that cannot work.
    pub(crate) complaint: Option<String>,
}

/// PWR: "on" and "ready" of the regulator and, on the F7, its overdrive.
fn power(family: Family) -> Bank {
    let mut rows: Vec<_> = (0..=0x2c).step_by(4).map(|offset| (offset, 0, ALL)).collect();
    match family {
        Family::F4 | Family::F7 => rows.push((4, 1 << 14 | 3 << 16, 0)),
        Family::H7 => rows.extend([(4, 1 << 13, 0), (0x18, 1 << 13 | 1 << 14, ALL), (0xc, 6, ALL)]),
    }
    Bank::new(&rows)
}

fn plain(last: u32) -> Bank {
    Bank::new(&(0..=last).step_by(4).map(|offset| (offset, 0, ALL)).collect::<Vec<_>>())
}

impl Bus {
    pub(crate) fn new(board: Board, phy: Phy, cells: Cells) -> Self {
        let family = board.family;
        let h7 = family == Family::H7;
        let mut bus = Self {
            board,
            now: 0,
            deadline: 0,
            instruction: 1,
            clocks: Rcc::new(family, Reset::Power).clocks(),
            core: Core::new(),
            rcc: Rcc::new(family, Reset::Power),
            flash: Flash::new(&board, cells),
            gpio: Gpio::new(BTreeMap::from([(
                REFERENCE_CLOCK,
                if phy.is_there { Drive::Clock } else { Drive::Level(false) },
            )])),
            timer: Timer::new(),
            random: Random::new(),
            watchdog: Watchdog::new(),
            uarts: std::array::from_fn(|_| Usart::new(family != Family::F4)),
            dma: Dma::new(family),
            stored: VecDeque::new(),
            spi: Spi::new(h7),
            ethernet: Ethernet::new(h7, phy),
            pwr: power(family),
            syscfg: plain(0x2c),
            exti: Exti::new(h7),
            target: None,
            revision: board.revision,
            axi: Bank::new(&[(0x108, 0, ALL)]),
            accesses: (0, 0),
            waits_for_flash: false,
            stalled_until: 0,
            bus_fault: None,
            complaint: None,
        };
        bus.follow_clocks();
        bus
    }

    /// Resets all but what a reset does not reach: the flash's cells, what is connected, and time.
    pub(crate) fn reset(&mut self, cause: Reset) {
        let cells = std::mem::replace(&mut self.flash.cells, Cells::new());
        let mut fresh = Self::new(self.board, self.ethernet.phy, cells);
        fresh.now = self.now;
        fresh.revision = self.revision;
        fresh.rcc = Rcc::new(self.board.family, cause);
        fresh.random = self.random.after_reset();
        std::mem::swap(fresh.gpio.driven(), self.gpio.driven());
        std::mem::swap(&mut fresh.uarts, &mut self.uarts);
        fresh.uarts.iter_mut().for_each(Usart::reset);
        fresh.target = self.target.take();
        *self = fresh;
    }

    pub(crate) fn follow_clocks(&mut self) {
        self.clocks = self.rcc.clocks();
        self.instruction = SECOND / self.clocks.core;
    }

    /// When something happens by itself.
    pub(crate) fn next_event(&self) -> Time {
        let uarts = self.uarts.iter().filter_map(Usart::next_event);
        let others = [
            self.timer.next_event(),
            self.watchdog.next_event(),
            self.flash.next_event(),
            self.spi.next_event(),
            self.ethernet.next_event(),
            self.stored.front().map(|&(at, ..)| at),
        ];
        uarts.chain(others.into_iter().flatten()).min().unwrap_or(Time::MAX)
    }

    /// Does what is due, and what follows from it: transfers by DMA, interrupts.
    pub(crate) fn advance(&mut self, memory: &mut impl Memory) {
        if !self.core.caches.data {
            return self.advance_with(memory);
        }
        let mut memory = Watched { memory, caches: self.core.caches.clone(), held: Cell::new(None) };
        self.advance_with(&mut memory);
        if let Some(address) = memory.held.get() {
            self.complain("lets DMA access", address, "which the data cache may hold");
        }
    }

    fn advance_with(&mut self, memory: &mut impl Memory) {
        let now = self.now;
        self.timer.advance(now);
        self.flash.advance(now);
        self.spi.advance(now, self.target.as_deref_mut());
        self.look_at_target();
        self.ethernet.advance(now, memory);
        self.uarts.iter_mut().for_each(|uart| uart.advance(now));
        while let Some((_, address, value)) = self.stored.pop_front_if(|&mut (at, ..)| at <= now) {
            memory.store(address, &[value]);
        }
        self.transfer(memory);
        self.check_pins();
        self.collect_interrupts();
    }

    /// Lets the interrupt pin of what is at the SPI have its level, and notes an edge.
    fn look_at_target(&mut self) {
        let Some(target) = &self.target else { return };
        let level = Drive::Level(target.interrupt(self.now));
        let before = self.gpio.driven().insert(SPI_INTERRUPT, level);
        // SYSCFG_EXTICR4: port D for line 15.
        let is_connected = self.syscfg.get(0x14) >> 12 & 0xf == SPI_INTERRUPT.0 as u32;
        if before != Some(level) && is_connected {
            self.exti.edge(SPI_INTERRUPT.1, level == Drive::Level(true));
        }
    }

    fn transfer(&mut self, memory: &mut impl Memory) {
        for (uart, (_, base, _)) in UARTS.into_iter().enumerate() {
            let (receive, transmit) = self.uarts[uart].data_offsets();
            while self.uarts[uart].wants_to_give() {
                let Some(item) = self.dma.take(Request::Received(uart)) else { break };
                self.check(&item, base + receive);
                let value = self.read(item.peripheral, item.bytes) as u8;
                self.stored.push_back((self.now + DMA_STORES, item.memory, value));
            }
            while self.uarts[uart].wants_to_take() {
                let Some(item) = self.dma.take(Request::Transmit(uart)) else { break };
                self.load(memory, item, base + transmit);
            }
        }
        let (receive, transmit) = self.spi.data_offsets();
        while self.spi.wants_to_give() {
            let Some(item) = self.dma.take(Request::SpiReceived) else { break };
            self.store(memory, item, SPI_BASE + receive);
        }
        while self.spi.wants_to_take() {
            let Some(item) = self.dma.take(Request::SpiTransmit) else { break };
            self.load(memory, item, SPI_BASE + transmit);
        }
    }

    /// Names a transfer from or to elsewhere than the register that is `expected`, or of memory that DMA does not reach.
    fn check(&mut self, item: &Item, expected: u32) {
        if item.peripheral != expected {
            self.complain("gives DMA", item.peripheral, "another register than its request's");
        }
        // The F4's CCM; the H7's ITCM and DTCM.
        let is_out_of_reach = match self.board.family {
            Family::F4 => item.memory >> 24 == 0x10,
            Family::F7 => false,
            Family::H7 => item.memory >> 24 == 0 || item.memory >> 24 == 0x20,
        };
        if is_out_of_reach {
            self.complain("gives DMA", item.memory, "memory that it does not reach");
        }
    }

    /// From a peripheral into memory.
    fn store(&mut self, memory: &mut impl Memory, item: Item, expected: u32) {
        self.check(&item, expected);
        let value = self.read(item.peripheral, item.bytes) as u32;
        memory.store(item.memory, &value.to_le_bytes()[..item.bytes]);
    }

    /// From memory into a peripheral.
    fn load(&mut self, memory: &mut impl Memory, item: Item, expected: u32) {
        self.check(&item, expected);
        let mut bytes = [0; 4];
        memory.load(item.memory, &mut bytes[..item.bytes]);
        self.write(item.peripheral, item.bytes, u64::from(u32::from_le_bytes(bytes)));
    }

    fn collect_interrupts(&mut self) {
        self.core.raise(chip::TIMER_INTERRUPT, self.timer.interrupts());
        self.core.raise(chip::FLASH_INTERRUPT, self.flash.interrupts());
        self.core.raise(chip::SPI_INTERRUPT, self.spi.interrupts());
        self.core.raise(chip::EXTI_INTERRUPT, self.exti.interrupts());
        self.core.raise(chip::ETHERNET_INTERRUPT, self.ethernet.interrupts());
        for (uart, (_, _, number)) in self.uarts.iter_mut().zip(UARTS) {
            if std::mem::take(&mut uart.pulse) {
                self.core.pend(number);
            }
            self.core.raise(number, uart.interrupts());
        }
        for (dma, numbers) in chip::DMA_INTERRUPTS.iter().enumerate() {
            for (stream, &number) in numbers.iter().enumerate() {
                self.core.raise(number, self.dma.interrupts(dma, stream as u32));
            }
        }
    }
}
