//! What this board is measured by: instructions spent while awake, and the depth of the stack.

use core::convert::Infallible;
use core::fmt::Write as _;
use core::ptr::addr_of;
use core::sync::atomic::{AtomicU32, AtomicUsize, Ordering};

use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::STACK_PAINT_VALUE;
use embedded_io_async::{Read, Write};
use heapless::String;
use mobgate_net::Sockets;

/// SysTick has 24 bits. It counts down, and sums of its differences are right modulo 2^24 without a look at each.
const ROUND: u32 = 0x00ff_ffff;

/// Ticks spent awake.
static BUSY: AtomicU32 = AtomicU32::new(0);
/// Of those, ticks spent in tasks, without what moves the bytes of UARTs, and on characters that are relayed.
static TASKS: AtomicU32 = AtomicU32::new(0);
static RELAY: AtomicU32 = AtomicU32::new(0);
/// Ticks spent on moving the bytes of UARTs, which DMA does on a chip.
static DRIVER: AtomicU32 = AtomicU32::new(0);

/// Lets SysTick count the processor's cycles down. With QEMU's `-icount` it counts instructions.
pub(crate) fn start(mut systick: SYST) {
    systick.set_clock_source(SystClkSource::Core);
    systick.set_reload(ROUND);
    systick.clear_current();
    systick.enable_counter();
}

/// Adds up the ticks spent awake; in a register, as each byte of a line that is relayed ends a sleep.
pub(crate) struct Busy(u32);

impl Busy {
    /// The processor is awake.
    pub(crate) fn begin() -> Self {
        Self(SYST::get_current())
    }

    /// It is about to sleep.
    pub(crate) fn fall_asleep(&mut self) {
        self.0 = self.0.wrapping_sub(SYST::get_current());
    }

    /// It has slept.
    pub(crate) fn wake_up(&mut self) {
        self.0 = self.0.wrapping_add(SYST::get_current());
    }

    /// Tasks run, one of which may want to know.
    pub(crate) fn in_tasks(&self, work: impl FnOnce()) {
        BUSY.store(self.0, Ordering::Relaxed);
        let (start, driver) = (SYST::get_current(), DRIVER.load(Ordering::Relaxed));
        work();
        let driver = DRIVER.load(Ordering::Relaxed).wrapping_sub(driver);
        add(&TASKS, start.wrapping_sub(SYST::get_current()).wrapping_sub(driver));
    }
}

fn add(sum: &AtomicU32, ticks: u32) {
    sum.store(sum.load(Ordering::Relaxed).wrapping_add(ticks), Ordering::Relaxed);
}

/// Adds to `sum` what `work` takes.
#[inline(always)] // as its callers
fn timed<T>(sum: &AtomicU32, work: impl FnOnce() -> T) -> T {
    let start = SYST::get_current();
    let done = work();
    add(sum, start.wrapping_sub(SYST::get_current()));
    done
}

/// Counts `work` as a UART driver's.
#[inline(always)] // at least as short as what it measures
pub(crate) fn in_driver<T>(work: impl FnOnce() -> T) -> T {
    timed(&DRIVER, work)
}

/// Counts `step`, which is a part of what a UART driver does, as the gateway's.
#[inline(always)] // at least as short as what it measures
pub(crate) fn in_relay<T>(step: impl FnOnce() -> T) -> T {
    timed(&RELAY, step)
}

/// The line whose waits for the processor are added up: from the interrupt that woke its task until that had read.
const WATCHED: usize = 1;
static WAITS: Sum = Sum::new();
/// The lines between which frames are passed on while they arrive: from the interrupt of the first bytes until they leave, but for
/// the time that the processor sleeps meanwhile.
const PASSING: [usize; 2] = [2, 3];
static PASSED: Sum = Sum::new();
/// How long the processor had been awake when the interrupt of the bytes came that a task of these lines has read last, and the
/// line that sent last.
static CAME: AtomicU32 = AtomicU32::new(0);
static SENT: AtomicUsize = AtomicUsize::new(0);

/// Times that are added up, in ticks.
struct Sum {
    total: AtomicU32,
    times: AtomicU32,
    longest: AtomicU32,
}

impl Sum {
    const fn new() -> Self {
        Self { total: AtomicU32::new(0), times: AtomicU32::new(0), longest: AtomicU32::new(0) }
    }

    fn add(&self, ticks: u32) {
        add(&self.total, ticks);
        add(&self.times, 1);
        self.longest.store(ticks.max(self.longest.load(Ordering::Relaxed)), Ordering::Relaxed);
    }

    /// Total, times and longest, from when this was last called.
    fn take(&self) -> [u32; 3] {
        [&self.total, &self.times, &self.longest].map(|count| count.swap(0, Ordering::Relaxed))
    }
}

/// What a task that reads waits for: first bytes, from their interrupt on the processor.
pub(crate) struct Wait(AtomicU32);

impl Wait {
    const NOTHING: u32 = 0;
    const BYTES: u32 = 1;
    /// The processor, since SysTick had this value.
    const PROCESSOR: u32 = 1 << 31;

    pub(crate) const fn new() -> Self {
        Self(AtomicU32::new(Self::NOTHING))
    }

    /// The task begins to read.
    pub(crate) fn begin(&self) {
        self.0.store(Self::BYTES, Ordering::Relaxed);
    }

    /// Bytes are there.
    pub(crate) fn woken(&self) {
        if self.0.load(Ordering::Relaxed) == Self::BYTES {
            self.0.store(Self::PROCESSOR | SYST::get_current(), Ordering::Relaxed);
        }
    }

    /// The task of `line` has read.
    pub(crate) fn end(&self, line: usize) {
        let since = self.0.load(Ordering::Relaxed);
        self.0.store(Self::NOTHING, Ordering::Relaxed);
        let waited =
            if since & Self::PROCESSOR == 0 { 0 } else { since.wrapping_sub(SYST::get_current()) & ROUND };
        if line == WATCHED && waited > 0 {
            WAITS.add(waited);
        }
        if PASSING.contains(&line) {
            CAME.store(awake().wrapping_sub(waited), Ordering::Relaxed);
        }
    }
}

/// The task of `line` sends: where the other line sent last, these are the first bytes of what that one has received.
pub(crate) fn sends(line: usize) {
    if PASSING.contains(&line) && SENT.swap(line, Ordering::Relaxed) != line {
        PASSED.add(awake().wrapping_sub(CAME.load(Ordering::Relaxed)) & ROUND);
    }
}

/// The ticks that the processor has been awake, up to now, where it is.
fn awake() -> u32 {
    BUSY.load(Ordering::Relaxed).wrapping_sub(SYST::get_current()) & ROUND
}

/// The most that the stack has ever held, in bytes.
fn stack_bytes() -> usize {
    unsafe extern "C" {
        static _stack_end: u32;
        static _stack_start: u32;
    }
    let (mut at, top) = (addr_of!(_stack_end), addr_of!(_stack_start));
    // SAFETY: the words between the two are the stack, which cortex-m-rt has painted; those below the deepest use are
    // read, which nobody writes meanwhile.
    while at < top && unsafe { at.read_volatile() } == STACK_PAINT_VALUE {
        at = at.wrapping_add(1);
    }
    top.addr() - at.addr()
}

/// Answers each byte on `line` with a line of figures, for ever: `b` asks for the ticks, `w` and `p` for waits and for what was
/// passed on, since the last such question, `m` for memory.
pub(crate) async fn report(
    mut line: impl Read<Error = Infallible> + Write<Error = Infallible>,
    sockets: &'static Sockets,
) {
    let mut asked = [0; 1];
    loop {
        let Ok(_) = line.read(&mut asked).await;
        let mut text = String::<64>::new();
        // It has room for three numbers.
        let _ = match asked {
            [b'b'] => {
                let busy = awake();
                let gateway =
                    TASKS.load(Ordering::Relaxed).wrapping_add(RELAY.load(Ordering::Relaxed)) & ROUND;
                writeln!(text, "busy {busy} gateway {gateway}")
            }
            [b'w' | b'p'] => {
                let sum = if asked == [b'w'] { &WAITS } else { &PASSED };
                let [total, times, longest] = sum.take();
                writeln!(text, "total {total} times {times} longest {longest}")
            }
            _ => writeln!(text, "stack {} sockets {}", stack_bytes(), sockets.free()),
        };
        let Ok(()) = line.write_all(text.as_bytes()).await;
    }
}
