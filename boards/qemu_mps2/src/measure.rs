//! What this board is measured by: instructions spent while awake, and the depth of the stack.

use core::fmt::Write as _;
use core::ptr::addr_of;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::STACK_PAINT_VALUE;
use embedded_io_async::{Read, Write};
use heapless::String;
use mobgate_net::Sockets;

use crate::uart::Line;

/// SysTick has 24 bits; no stretch of work takes the 0.6 s in which it comes round.
const ROUND: u32 = 0x00ff_ffff;

/// Ticks spent awake, modulo 2^32.
static BUSY: AtomicU32 = AtomicU32::new(0);
/// Of those, ticks spent on moving bytes from and to UARTs, which DMA does on a chip.
static DRIVER: AtomicU32 = AtomicU32::new(0);
static WOKEN_AT: AtomicU32 = AtomicU32::new(0);

/// Lets SysTick count the processor's cycles down. With QEMU's `-icount` it counts instructions.
pub(crate) fn start(mut systick: SYST) {
    systick.set_clock_source(SystClkSource::Core);
    systick.set_reload(ROUND);
    systick.clear_current();
    systick.enable_counter();
    wake_up();
}

/// The processor is about to sleep.
pub(crate) fn fall_asleep() {
    let spent = WOKEN_AT.load(Ordering::Relaxed).wrapping_sub(SYST::get_current()) & ROUND;
    BUSY.store(BUSY.load(Ordering::Relaxed).wrapping_add(spent), Ordering::Relaxed);
}

/// The processor has slept.
pub(crate) fn wake_up() {
    WOKEN_AT.store(SYST::get_current(), Ordering::Relaxed);
}

/// Counts `work` as a UART driver's.
pub(crate) fn in_driver(work: impl FnOnce()) {
    let start = SYST::get_current();
    work();
    let spent = start.wrapping_sub(SYST::get_current()) & ROUND;
    DRIVER.store(DRIVER.load(Ordering::Relaxed).wrapping_add(spent), Ordering::Relaxed);
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

/// Answers each byte on `line` with a line of figures, for ever: `b` asks for the ticks, `m` for memory.
pub(crate) async fn report(mut line: Line, sockets: &'static Sockets) {
    let mut asked = [0; 1];
    loop {
        let Ok(_) = line.read(&mut asked).await;
        let mut text = String::<64>::new();
        // It has room for two numbers.
        let _ = match asked {
            [b'b'] => {
                let (busy, driver) = (BUSY.load(Ordering::Relaxed), DRIVER.load(Ordering::Relaxed));
                writeln!(text, "busy {busy} driver {driver}")
            }
            _ => writeln!(text, "stack {} sockets {}", stack_bytes(), sockets.free()),
        };
        let Ok(()) = line.write_all(text.as_bytes()).await;
    }
}
