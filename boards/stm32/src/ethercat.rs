//! EtherCAT with a LAN9252 on SPI1, which may be absent at first.

use core::pin::pin;

use embassy_embedded_hal::shared_bus::asynch::spi::SpiDevice;
use embassy_executor::Spawner;
use embassy_stm32::exti::ExtiInput;
use embassy_stm32::gpio::{Level, Output, Pull, Speed};
use embassy_stm32::interrupt::typelevel::{Binding, DMA2_STREAM0, DMA2_STREAM3, EXTI15_10};
use embassy_stm32::mode::Async;
use embassy_stm32::peripherals::{
    DMA2_CH0, DMA2_CH3, EXTI12, EXTI13, EXTI15, PA5, PA6, PB5, PD14, PD15, PF12, PF13, SPI1,
};
use embassy_stm32::spi::mode::Master;
use embassy_stm32::spi::{Config, Spi};
use embassy_stm32::time::Hertz;
use embassy_stm32::{Peri, dma, exti};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use ethercat_subdevice::clocks::SyncSignals;
use ethercat_subdevice::lan9252::{Lan9252, Wiring};
use mobgate::fieldbus::serve;
use mobgate_firmware::gateway::{LIVENESS, Task};
use mobgate_firmware::states::{ETHERCAT, FILES, SCANNER};

use crate::spi::Bus;

/// Fastest clock at which the LAN9252 needs no pauses within reads. The resulting clocks: 25 MHz on the H7, 27 on the F7, 21 on the
/// F4.
const SPI_HZ: Hertz = Hertz(30_000_000);
/// The slowest of these.
const SPI_CLOCK_HZ_MIN: u32 = 21_000_000;
/// The processor's share of a chip select. Eight of them and the 25 us of a cycle are the time of a cycle's instructions, at one a
/// clock, and a quarter for the flash's wait states: counted in the emulator by `cargo xtask test stm32`, not measured on a board.
const SELECT_NS: u32 = if cfg!(feature = "h7") {
    6_000
} else if cfg!(feature = "f7") {
    12_000
} else {
    17_000
};

/// The wires to the controller.
pub(crate) struct Wires {
    spi: Spi<'static, Async, Master>,
    select: Output<'static>,
    /// High when the controller requests attention.
    interrupt: ExtiInput<'static, Async>,
    sync0: ExtiInput<'static, Async>,
    sync1: ExtiInput<'static, Async>,
}

/// SPI1 with its clock, output and input.
type Spi1 = (Peri<'static, SPI1>, Peri<'static, PA5>, Peri<'static, PB5>, Peri<'static, PA6>);
/// Its channels to transmit and to receive.
type Channels = (Peri<'static, DMA2_CH3>, Peri<'static, DMA2_CH0>);
/// A pin whose edges interrupt.
type Signal<P, C> = (Peri<'static, P>, Peri<'static, C>);

impl Wires {
    /// SPI1 with DMA in mode 0 and the chip select; the interrupt pin and those of SYNC0 and SYNC1. `interrupts` comes from
    /// `bind_interrupts!`. If no controller drives MISO, all bits read as ones.
    pub(crate) fn new(
        ((spi, clock, output, input), (transmit, receive), select): (Spi1, Channels, Peri<'static, PD14>),
        (interrupt, sync0, sync1): (Signal<PD15, EXTI15>, Signal<PF12, EXTI12>, Signal<PF13, EXTI13>),
        interrupts: impl Binding<DMA2_STREAM3, dma::InterruptHandler<DMA2_CH3>>
        + Binding<DMA2_STREAM0, dma::InterruptHandler<DMA2_CH0>>
        + Binding<EXTI15_10, exti::InterruptHandler<EXTI15_10>>
        + 'static,
    ) -> Self {
        let mut config = Config::default();
        config.frequency = SPI_HZ;
        config.miso_pull = Pull::Up;
        Self {
            spi: Spi::new(spi, clock, output, input, transmit, receive, interrupts, config),
            select: Output::new(select, Level::High, Speed::VeryHigh),
            interrupt: ExtiInput::new(interrupt.0, interrupt.1, Pull::Down, interrupts),
            // Without a wire there is no pulse, which the MainDevice is told.
            sync0: ExtiInput::new(sync0.0, sync0.1, Pull::Down, interrupts),
            sync1: ExtiInput::new(sync1.0, sync1.1, Pull::Down, interrupts),
        }
    }
}

/// Starts the task, which waits for the controller.
pub(crate) fn start(spawner: Spawner, wires: Wires) {
    let Wires { spi, select, interrupt, sync0, sync1 } = wires;
    // Spawned once: the task slots are free.
    spawner.spawn(note(sync0, SyncSignals::sync0).unwrap());
    spawner.spawn(note(sync1, SyncSignals::sync1).unwrap());
    spawner.spawn(run(spi, select, interrupt).unwrap());
}

static SYNC: SyncSignals = SyncSignals::new();

/// Notes the edges of a SYNC signal, which the pin does not keep.
#[embassy_executor::task(pool_size = 2)]
async fn note(mut pin: ExtiInput<'static, Async>, signal: fn(&'static SyncSignals)) -> ! {
    loop {
        pin.wait_for_rising_edge().await;
        signal(&SYNC);
    }
}

#[embassy_executor::task]
async fn run(
    spi: Spi<'static, Async, Master>,
    select: Output<'static>,
    interrupt: ExtiInput<'static, Async>,
) -> ! {
    LIVENESS.watch(Task::Ethercat as usize, pin!(serve_controller(spi, select, interrupt))).await
}

async fn serve_controller(
    spi: Spi<'static, Async, Master>,
    select: Output<'static>,
    mut interrupt: ExtiInput<'static, Async>,
) -> ! {
    let bus = Mutex::<NoopRawMutex, _>::new(Bus(spi));
    let wiring = Wiring { spi_hz: SPI_CLOCK_HZ_MIN, select_ns: SELECT_NS, ..Wiring::default() };
    let controller = Lan9252::new(SpiDevice::new(&bus, select), wiring);
    let attention = async || interrupt.wait_for_high().await;
    serve(&ETHERCAT, Some(&SCANNER), &FILES, controller, Some(&SYNC), attention).await
}
