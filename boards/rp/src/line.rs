//! An RS-485 line on two state machines of a PIO, with DMA in both directions.
//!
//! Not on a UART: the RP2040's have no interrupt at the end of the last stop bit, so the driver's release would depend on how busy
//! the program is. A PIO releases it by itself, on as many lines as there are pairs of state machines.
//!
//! Receiving: the PIO raises an interrupt for every character, which wakes the port's task unless it rests, and DMA has stored it by then, also
//! while the program stands still because the flash is erased.

use core::future::poll_fn;
use core::mem::forget;
use core::sync::atomic::{AtomicBool, Ordering};
use core::task::Poll;

use embassy_rp::clocks::clk_sys_freq;
use embassy_rp::dma::Channel;
use embassy_rp::gpio::{Level, Pull};
use embassy_rp::interrupt::typelevel::{Handler, Interrupt};
use embassy_rp::pac;
use embassy_rp::pac::dma::vals::{DataSize, TreqSel};
use embassy_rp::pio::{
    Config, Direction, FifoJoin, Instance, Pin, ShiftDirection, StateMachine, StatusSource,
};
use embassy_sync::waitqueue::AtomicWaker;
use embassy_time::Instant;
use embedded_io_async::{ErrorKind, ErrorType, Read, Write};
use mobgate::hal::{Flaws, OpenError, OpenErrorKind, SerialLine};
use mobgate::settings::{Driver, LineSettings};
use mobgate_firmware::lines::{self, LINES, Line};

use crate::character::Format;
use crate::program::{CYCLES_PER_BIT, Programs};

/// Characters of a receive buffer: nearly 100 ms at 115200 baud. Erasing a sector of the flash takes 45 ms (400 ms at worst).
pub(crate) const RING_CHARACTERS: usize = 1024;
/// Characters that are handed to DMA at a time: the longest frame.
const WORDS: usize = 256;
/// Transfers of a DMA channel, which then has to be started again.
const TRANSFERS: u32 = u32::MAX;

/// A receive buffer. A DMA channel wraps addresses at multiples of the buffer's size.
#[repr(C, align(2048))]
pub(crate) struct Ring(pub(crate) [u16; RING_CHARACTERS]);
const _: () = assert!(size_of::<Ring>() == align_of::<Ring>());

/// The task that waits for a line's characters.
struct Reader {
    waker: AtomicWaker,
    /// It needs none now.
    rests: AtomicBool,
}

/// In the order of the lines: two lines for each PIO.
static READERS: [Reader; LINES] =
    [const { Reader { waker: AtomicWaker::new(), rests: AtomicBool::new(false) } }; LINES];
/// State machines of a line.
const MACHINES: usize = 2;

/// The interrupt of PIO `N`: a character has been received.
pub(crate) struct LineInterrupt<const N: usize>;

impl<const N: usize, I: Interrupt> Handler<I> for LineInterrupt<N> {
    unsafe fn on_interrupt() {
        let pio = if N == 0 { pac::PIO0 } else { pac::PIO1 };
        let flags = pio.irq().read().0;
        pio.irq().write(|clear| clear.0 = flags);
        for (nth, reader) in READERS[N * 2..][..2].iter().enumerate() {
            if flags & 1 << receiver(nth) != 0 && !reader.rests.load(Ordering::Relaxed) {
                reader.waker.wake();
            }
        }
    }
}

/// The state machine that receives on a PIO's line `nth`; the one before it transmits.
const fn receiver(nth: usize) -> usize {
    nth * MACHINES + 1
}

pub(crate) struct PioLine {
    pio: pac::pio::Pio,
    transmitter: usize,
    receiver: usize,
    /// Where their programs begin.
    origins: [u8; 2],
    reader: &'static Reader,
    format: Format,
    transmit: Channel<'static>,
    transmit_request: TreqSel,
    words: [u16; WORDS],
    receive: Channel<'static>,
    ring: &'static Ring,
    /// Characters that earlier runs of the channel stored.
    before: u32,
    /// Characters that were read, modulo 2^32.
    taken: u32,
    flaws: Flaws,
}

/// A line's pins.
pub(crate) struct Pins<P: Instance + 'static> {
    pub(crate) transmit: Pin<'static, P>,
    pub(crate) receive: Pin<'static, P>,
    pub(crate) driver: Pin<'static, P>,
}

impl PioLine {
    /// Line `number`, on a pair of state machines of the PIO whose interrupt is bound to [`LineInterrupt`]. Its driver is off.
    pub(crate) fn new<P: Instance, const T: usize, const R: usize>(
        number: usize,
        programs: &Programs<'static, P>,
        (mut transmitter, mut receiver): (StateMachine<'static, P, T>, StateMachine<'static, P, R>),
        (transmit, receive): (Channel<'static>, Channel<'static>),
        mut pins: Pins<P>,
        ring: &'static mut Ring,
    ) -> Self {
        const { assert!(R == T + 1) };
        // An idle transceiver may leave the pin floating.
        pins.receive.set_pull(Pull::Up);
        transmitter.set_pins(Level::High, &[&pins.transmit]);
        transmitter.set_pins(Level::Low, &[&pins.driver]);
        transmitter.set_pin_dirs(Direction::Out, &[&pins.transmit, &pins.driver]);
        receiver.set_pin_dirs(Direction::In, &[&pins.receive]);
        let mut config = Config::default();
        config.use_program(&programs.transmit, &[&pins.driver]);
        config.set_out_pins(&[&pins.transmit]);
        config.shift_out.direction = ShiftDirection::Right;
        config.fifo_join = FifoJoin::TxOnly;
        // STATUS is all ones while less than one word waits.
        (config.status_sel, config.status_n) = (StatusSource::TxFifoLevel, 1);
        transmitter.set_config(&config);
        let mut config = Config::default();
        config.use_program(&programs.receive, &[]);
        config.set_in_pins(&[&pins.receive]);
        config.set_jmp_pin(&pins.receive);
        config.shift_in.direction = ShiftDirection::Right;
        config.fifo_join = FifoJoin::RxOnly;
        receiver.set_config(&config);
        let from = receiver.rx_fifo_ptr();
        let (receives, transmits) = (receiver.rx_treq(), transmitter.tx_treq());
        let pio = if number < LINES / 2 { pac::PIO0 } else { pac::PIO1 };
        pio.irqs(1).inte().modify(|enabled| enabled.0 |= 1 << (8 + R));
        // Dropping them would release the pins.
        forget((transmitter, receiver, pins));
        let line = Self {
            pio,
            transmitter: T,
            receiver: R,
            origins: [programs.transmit.origin, programs.receive.origin],
            reader: &READERS[number],
            format: Format::new(&LineSettings::DEFAULT),
            transmit,
            transmit_request: transmits,
            words: [0; WORDS],
            receive,
            ring,
            before: 0,
            taken: 0,
            flaws: Flaws::default(),
        };
        line.start_receiving(from, receives);
        line
    }

    /// Starts the channel that stores characters.
    fn start_receiving(&self, from: *mut u32, request: TreqSel) {
        let channel = self.receive.regs();
        // The upper half of each word.
        channel.read_addr().write_value(from as u32 + 2);
        channel.write_addr().write_value(&raw const *self.ring as u32);
        channel.trans_count().write_value(TRANSFERS);
        let number = channel_number(&self.receive);
        channel.ctrl_trig().write(|control| {
            control.set_treq_sel(request);
            control.set_data_size(DataSize::SIZE_HALFWORD);
            control.set_incr_write(true);
            control.set_ring_sel(true);
            control.set_ring_size(size_of::<Ring>().ilog2() as u8);
            // Itself: none.
            control.set_chain_to(number);
            control.set_en(true);
        });
    }

    /// Characters stored so far, modulo 2^32.
    fn stored(&mut self) -> u32 {
        let channel = self.receive.regs();
        if !channel.ctrl_trig().read().busy() {
            self.before = self.before.wrapping_add(TRANSFERS);
            channel.al1_trans_count_trig().write_value(TRANSFERS);
        }
        self.before.wrapping_add(TRANSFERS - channel.trans_count().read())
    }

    /// Moves received characters into `into`; returns how many.
    fn take(&mut self, into: &mut [u8]) -> usize {
        let stored = self.stored();
        let waiting = stored.wrapping_sub(self.taken) as usize;
        if waiting > RING_CHARACTERS {
            // What is there has no beginning and no end.
            defmt::warn!("a line's characters were not read in time");
            self.flaws.overruns = self.flaws.overruns.saturating_add(1);
            self.taken = stored;
            return 0;
        }
        let count = waiting.min(into.len());
        for byte in into.iter_mut().take(count) {
            let at = self.taken as usize % RING_CHARACTERS;
            // SAFETY: in bounds; DMA writes this memory, and has written this word.
            let word = unsafe { (&raw const self.ring.0[at]).read_volatile() };
            *byte = self.format.decode(word, &mut self.flaws);
            self.taken = self.taken.wrapping_add(1);
        }
        count
    }

    /// Stops both machines, empties their FIFOs, and starts them with another clock and format. The driver is off.
    fn restart(&mut self, divider: u32, format: Format) {
        let machines = 1 << self.transmitter | 1 << self.receiver;
        let set = |enable: bool| {
            // Both lines of a PIO have it, but tasks only.
            self.pio.ctrl().modify(|control| {
                let others = control.sm_enable() & !machines;
                control.set_sm_enable(if enable { others | machines } else { others });
                control.set_sm_restart(machines);
                control.set_clkdiv_restart(machines);
            });
        };
        set(false);
        for (machine, origin) in [self.transmitter, self.receiver].into_iter().zip(self.origins) {
            let machine = self.pio.sm(machine);
            machine.clkdiv().write(|clock| clock.0 = divider << 8);
            // Changing the join of the FIFOs empties them.
            for _ in 0..2 {
                machine.shiftctrl().modify(|shift| shift.set_fjoin_rx(!shift.fjoin_rx()));
            }
            // "jmp origin"
            machine.instr().write(|instruction| instruction.0 = origin.into());
        }
        // "set y, bits - 1"
        let set_y = 0xe040 | u32::from(format.bits() - 1);
        self.pio.sm(self.receiver).instr().write(|instruction| instruction.0 = set_y);
        set(true);
        self.format = format;
        self.taken = self.stored();
        self.flaws = Flaws::default();
    }
}

/// The number of a channel, from the place of its registers.
fn channel_number(channel: &Channel<'_>) -> u8 {
    let size = pac::DMA.ch(1).as_ptr() as usize - pac::DMA.ch(0).as_ptr() as usize;
    ((channel.regs().as_ptr() as usize - pac::DMA.as_ptr() as usize) / size) as u8
}

/// The clock divider for `baud`, in 256ths, if the machines have one.
fn divider(baud: u32) -> Option<u32> {
    let per_second = u64::from(baud) * u64::from(CYCLES_PER_BIT);
    let divider = (u64::from(clk_sys_freq()) * 256 + per_second / 2).checked_div(per_second)?;
    (0x100..0x100_0000).contains(&divider).then_some(divider as u32)
}

impl Line for PioLine {
    // Erasing the flash stops the program.
    const NEVER_UNDERRUNS: bool = false;

    fn configure(&mut self, line: &LineSettings) -> Result<(), OpenError> {
        let unsupported = |hint| OpenError::new(OpenErrorKind::Unsupported, hint);
        if line.driver == Driver::Rts {
            return Err(unsupported("the board switches the driver by itself: remove the word rts"));
        }
        if line.driver_before.max(line.driver_after).as_ticks() > 0 {
            return Err(unsupported(
                "driver-before and driver-after: this board has a bit before, two after",
            ));
        }
        let divider = divider(line.baud).ok_or(unsupported("speed"))?;
        self.restart(divider, Format::new(line));
        Ok(())
    }
}

impl SerialLine for PioLine {
    const RESTS: bool = true;

    async fn rest(&mut self, until: Instant) -> bool {
        lines::rest(until, |rests| self.reader.rests.store(rests, Ordering::Relaxed)).await
    }

    fn take_flaws(&mut self) -> Flaws {
        core::mem::take(&mut self.flaws)
    }
}

impl ErrorType for PioLine {
    type Error = ErrorKind;
}

impl Read for PioLine {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, ErrorKind> {
        let count = poll_fn(|context| {
            self.reader.waker.register(context.waker());
            match self.take(into) {
                0 => Poll::Pending,
                count => Poll::Ready(count),
            }
        });
        Ok(count.await)
    }
}

impl Write for PioLine {
    async fn write(&mut self, from: &[u8]) -> Result<usize, ErrorKind> {
        let count = from.len().min(WORDS);
        for (word, &byte) in self.words.iter_mut().zip(from) {
            *word = self.format.encode(byte);
        }
        if let Some(words) = self.words.get(..count).filter(|words| !words.is_empty()) {
            let to = self.pio.txf(self.transmitter).as_ptr().cast();
            // SAFETY: the channel belongs to this line; dropping the transfer stops it, so it does not outlive `words`.
            unsafe { self.transmit.write::<u16>(words, to, self.transmit_request, false) }.await;
        }
        Ok(count)
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        Ok(())
    }
}
