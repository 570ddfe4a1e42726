//! Measures this board: instructions while awake, and stack depth.

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

/// SysTick has 24 bits. It counts down, and sums of differences are correct modulo 2^24 without masking each.
const ROUND: u32 = 0x00ff_ffff;

/// Ticks spent awake.
static BUSY: AtomicU32 = AtomicU32::new(0);
/// Of those, ticks spent in tasks without UART drivers, and ticks spent on relayed characters.
static TASKS: AtomicU32 = AtomicU32::new(0);
static RELAY: AtomicU32 = AtomicU32::new(0);
/// Ticks spent on moving the bytes of UARTs, which DMA does on a real chip.
static DRIVER: AtomicU32 = AtomicU32::new(0);

/// Starts SysTick, which counts the processor's cycles down. With QEMU's `-icount` it counts instructions.
pub(crate) fn start(mut systick: SYST) {
    systick.set_clock_source(SystClkSource::Core);
    systick.set_reload(ROUND);
    systick.clear_current();
    systick.enable_counter();
}

/// Sums the ticks spent awake; in a local variable for speed, as each byte of a relayed line ends a sleep.
pub(crate) struct Busy(u32);

impl Busy {
    /// Starts with the processor awake.
    pub(crate) fn begin() -> Self {
        Self(SYST::get_current())
    }

    /// Called before the processor sleeps.
    pub(crate) fn fall_asleep(&mut self) {
        self.0 = self.0.wrapping_sub(SYST::get_current());
    }

    /// Called after it has slept.
    pub(crate) fn wake_up(&mut self) {
        self.0 = self.0.wrapping_add(SYST::get_current());
    }

    /// Runs the tasks, with the sum published for the one that reports it.
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

/// Adds the duration of `work` to `sum`.
#[inline(always)] // like its callers
fn timed<T>(sum: &AtomicU32, work: impl FnOnce() -> T) -> T {
    let start = SYST::get_current();
    let done = work();
    add(sum, start.wrapping_sub(SYST::get_current()));
    done
}

/// Counts `work` as UART driver time.
#[inline(always)] // a call would distort the measurement
pub(crate) fn in_driver<T>(work: impl FnOnce() -> T) -> T {
    timed(&DRIVER, work)
}

/// Counts `step`, a part of a UART driver's work, as the gateway's time.
#[inline(always)] // a call would distort the measurement
pub(crate) fn in_relay<T>(step: impl FnOnce() -> T) -> T {
    timed(&RELAY, step)
}

/// The line whose waits for the processor are summed: from the interrupt that wakes its task until the task has read.
const WATCHED: usize = 1;
static WAITS: Sum = Sum::new();
/// The lines between which frames are forwarded while they arrive. Measured from the interrupt of the first bytes until they leave,
/// without the time that the processor sleeps.
const PASSING: [usize; 2] = [2, 3];
static PASSED: Sum = Sum::new();
/// The awake time at the interrupt of the bytes that a task of these lines read last, and the line that sent last.
static CAME: AtomicU32 = AtomicU32::new(0);
static SENT: AtomicUsize = AtomicUsize::new(0);

/// A sum of times, in ticks.
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

    /// Total, count and longest since the last call.
    fn take(&self) -> [u32; 3] {
        [&self.total, &self.times, &self.longest].map(|count| count.swap(0, Ordering::Relaxed))
    }
}

/// What a reading task waits for: bytes, and after their interrupt the processor.
pub(crate) struct Wait(AtomicU32);

impl Wait {
    const NOTHING: u32 = 0;
    const BYTES: u32 = 1;
    /// Waiting for the processor, since the SysTick value in the other bits.
    const PROCESSOR: u32 = 1 << 31;

    pub(crate) const fn new() -> Self {
        Self(AtomicU32::new(Self::NOTHING))
    }

    /// The task starts to read.
    pub(crate) fn begin(&self) {
        self.0.store(Self::BYTES, Ordering::Relaxed);
    }

    /// Bytes have arrived.
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

/// The task of `line` sends. If the other line sent last, these are the first bytes that it received.
pub(crate) fn sends(line: usize) {
    if PASSING.contains(&line) && SENT.swap(line, Ordering::Relaxed) != line {
        PASSED.add(awake().wrapping_sub(CAME.load(Ordering::Relaxed)) & ROUND);
    }
}

/// Ticks that the processor has been awake; to be called while it is.
fn awake() -> u32 {
    BUSY.load(Ordering::Relaxed).wrapping_sub(SYST::get_current()) & ROUND
}

/// The deepest use of the stack so far, in bytes.
fn stack_bytes() -> usize {
    unsafe extern "C" {
        static _stack_end: u32;
        static _stack_start: u32;
    }
    let (mut at, top) = (addr_of!(_stack_end), addr_of!(_stack_start));
    // SAFETY: the words between the two symbols are the stack, painted by cortex-m-rt. Only words up to the deepest use are read,
    // and nobody writes them meanwhile.
    while at < top && unsafe { at.read_volatile() } == STACK_PAINT_VALUE {
        at = at.wrapping_add(1);
    }
    top.addr() - at.addr()
}

/// Answers each byte on `line` with a line of figures; never returns. `b`: ticks awake; `w` and `p`: waits and forwarding times
/// since the last such query; anything else: memory.
pub(crate) async fn report(
    mut line: impl Read<Error = Infallible> + Write<Error = Infallible>,
    sockets: &'static Sockets,
) {
    let mut asked = [0; 1];
    loop {
        let Ok(_) = line.read(&mut asked).await;
        let mut text = String::<64>::new();
        // Sized for three numbers.
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
