//! A Raspberry Pi Pico with a W5500: its pins, state machines and channels. See boards/README.md for the connectors.

use core::fmt::Write;

use embassy_executor::Spawner;
use embassy_rp::dma::{self, Channel};
use embassy_rp::gpio::{Input, Level, Output, Pull};
use embassy_rp::peripherals as p;
use embassy_rp::pio::{self, Pio};
use embassy_rp::spi::{self, Spi};
use embassy_rp::usb;
use embassy_rp::{Peripherals, bind_interrupts, pac};
use embassy_sync::mutex::Mutex;
use embedded_hal_bus::spi::ExclusiveDevice;
use mobgate_firmware::gateway::PORTS;
use mobgate_firmware::lines::{LINES, Lines, SharedLine};
use mobgate_firmware::network::{Network, Runner};
use mobgate_firmware::start::is_held;
use mobgate_firmware::system::Board;
use mobgate_firmware::{console as terminal, gateway, network, watchdog};
use mobgate_image::Info;
use mobgate_rp_boot::flash::{Chip as FlashChip, UNIQUE_BYTES};
use static_cell::{ConstStaticCell, StaticCell};

use crate::console::{self, Console};
use crate::ethernet::{self, Chip, LateEthernet, Wires};
use crate::flash::{ChipFlash, SharedFlash, settings, updater};
use crate::light::Light;
use crate::line::{LineInterrupt, Pins, PioLine, RING_CHARACTERS, Ring};
use crate::program::Programs;
use crate::start;

/// The W5500 allows 33 MHz.
const SPI_HZ: u32 = 31_250_000;

bind_interrupts!(struct Interrupts {
    PIO0_IRQ_0 => pio::InterruptHandler<p::PIO0>;
    PIO1_IRQ_0 => pio::InterruptHandler<p::PIO1>;
    PIO0_IRQ_1 => LineInterrupt<0>;
    PIO1_IRQ_1 => LineInterrupt<1>;
    DMA_IRQ_0 => dma::InterruptHandler<p::DMA_CH0>, dma::InterruptHandler<p::DMA_CH1>,
        dma::InterruptHandler<p::DMA_CH2>, dma::InterruptHandler<p::DMA_CH3>,
        dma::InterruptHandler<p::DMA_CH4>, dma::InterruptHandler<p::DMA_CH5>,
        dma::InterruptHandler<p::DMA_CH6>, dma::InterruptHandler<p::DMA_CH7>,
        dma::InterruptHandler<p::DMA_CH8>, dma::InterruptHandler<p::DMA_CH9>;
    USBCTRL_IRQ => usb::InterruptHandler<p::USB>;
});

static RINGS: ConstStaticCell<[Ring; LINES]> =
    ConstStaticCell::new([const { Ring([0; RING_CHARACTERS]) }; LINES]);
static SHARED: StaticCell<[SharedLine<PioLine>; LINES]> = StaticCell::new();
static SERIAL: StaticCell<heapless::String<{ 2 * UNIQUE_BYTES }>> = StaticCell::new();

/// Line `$number` of the peripherals `$p`: its ring, PIO, programs and state machines, its DMA channels, and its pins.
macro_rules! line {
    ($p:ident, $ring:expr, $number:literal, $pio:ident, $programs:expr, $transmitter:ident, $receiver:ident,
     $to:ident, $from:ident, $transmit:ident, $receive:ident, $driver:ident) => {{
        let pins = Pins {
            transmit: $pio.common.make_pio_pin($p.$transmit),
            receive: $pio.common.make_pio_pin($p.$receive),
            driver: $pio.common.make_pio_pin($p.$driver),
        };
        let channels = (Channel::new($p.$to, Interrupts), Channel::new($p.$from, Interrupts));
        PioLine::new($number, $programs, ($pio.$transmitter, $pio.$receiver), channels, pins, $ring)
    }};
}

/// Runs the gateway on the board that `info` names.
pub async fn run(spawner: Spawner, info: &'static Info, p: Peripherals) -> ! {
    let cause = start::cause();
    // Before anything that may hang; the boot loader has started it, unless a debugger started the program.
    mobgate_rp_boot::watchdog::start();
    let mut light = Light(Output::new(p.PIN_25, Level::Low));
    // Pressed, it connects the pin to ground.
    let button = Input::new(p.PIN_22, Pull::Up);
    let forget = is_held(|| button.is_low(), &mut light).await;
    let mut flash = FlashChip::new(p.FLASH);
    let unique = flash.unique();

    let (mut pio0, mut pio1) = (Pio::new(p.PIO0, Interrupts), Pio::new(p.PIO1, Interrupts));
    let (programs0, programs1) = (Programs::load(&mut pio0.common), Programs::load(&mut pio1.common));
    let [ring1, ring2, ring3, ring4] = RINGS.take().each_mut();
    let lines = [
        line!(p, ring1, 0, pio0, &programs0, sm0, sm1, DMA_CH0, DMA_CH1, PIN_0, PIN_1, PIN_2),
        line!(p, ring2, 1, pio0, &programs0, sm2, sm3, DMA_CH2, DMA_CH3, PIN_4, PIN_5, PIN_3),
        line!(p, ring3, 2, pio1, &programs1, sm0, sm1, DMA_CH4, DMA_CH5, PIN_6, PIN_7, PIN_8),
        line!(p, ring4, 3, pio1, &programs1, sm2, sm3, DMA_CH6, DMA_CH7, PIN_9, PIN_10, PIN_11),
    ];
    let lines = Lines(SHARED.init(lines.map(SharedLine::new)));
    for interrupt in [pac::Interrupt::PIO0_IRQ_1, pac::Interrupt::PIO1_IRQ_1] {
        // SAFETY: no critical section here relies on masking single interrupts.
        unsafe { cortex_m::peripheral::NVIC::unmask(interrupt) };
    }

    let mut config = spi::Config::default();
    config.frequency = SPI_HZ;
    let bus = Spi::new(p.SPI0, p.PIN_18, p.PIN_19, p.PIN_16, p.DMA_CH8, p.DMA_CH9, Interrupts, config);
    pac::PADS_BANK0.gpio(16).modify(|pad| {
        pad.set_pde(true);
        pad.set_pue(false);
    });
    // The pin begins high, so this cannot fail.
    let Ok(device) = ExclusiveDevice::new_no_delay(bus, Output::new(p.PIN_17, Level::High));
    let wires = Wires {
        device,
        interrupt: Input::new(p.PIN_21, Pull::Up),
        reset: Output::new(p.PIN_20, Level::High),
    };
    let address = mobgate_board::ethernet_address(&unique);
    let (driver, state) = LateEthernet::new(address);
    let (network, runner) = network::start(spawner, driver, &unique);
    let board = Board::new(info.board(), network, cause, mobgate_rp_boot::restart);
    gateway::start(spawner, network);
    // Each pool has room for the tasks spawned here, and this runs once: no `unwrap` can fail.
    spawner.spawn(stack(runner).unwrap());
    spawner.spawn(chip(wires, address, state).unwrap());
    for index in 0..PORTS {
        spawner.spawn(port(index, lines, network).unwrap());
    }
    let (port, device) = console::new(usb::Driver::new(p.USB, Interrupts), info.board(), serial(&unique));
    spawner.spawn(console::run(device).unwrap());
    spawner.spawn(serve(board, port, ChipFlash(flash), info, forget).unwrap());
    watchdog::watch(mobgate_rp_boot::watchdog::feed, &mut light, network).await
}

/// Fills `into` with bits of the ring oscillator: good enough for the salt of a password, which need not be secret.
#[cfg(feature = "users")] // Images without them are smaller, see Cargo.toml.
fn random(into: &mut [u8]) -> bool {
    embassy_rp::clocks::RoscRng.fill_bytes(into);
    true
}

/// The unique number in hexadecimal.
fn serial(unique: &[u8; UNIQUE_BYTES]) -> &'static str {
    let text = SERIAL.init(heapless::String::new());
    for byte in unique {
        // It fits.
        let _ = write!(text, "{byte:02X}");
    }
    text
}

#[embassy_executor::task]
async fn stack(mut runner: Runner<LateEthernet>) -> ! {
    network::stack(&mut runner).await
}

#[embassy_executor::task]
async fn chip(wires: Wires, address: [u8; 6], state: &'static Chip) -> ! {
    ethernet::run(wires, address, state).await
}

#[embassy_executor::task(pool_size = PORTS)]
async fn port(index: usize, lines: Lines<PioLine>, network: Network) -> ! {
    gateway::port(index, lines, network).await
}

#[embassy_executor::task]
async fn serve(
    mut board: Board,
    mut port: Console,
    flash: ChipFlash,
    info: &'static Info,
    forget: bool,
) -> ! {
    #[cfg(feature = "users")]
    board.set_random(random);
    let flash = SharedFlash::new(flash);
    let firmware = Mutex::new(updater(&flash, *info));
    terminal::run(&mut board, &mut port, settings(&flash), 0, &firmware, forget).await
}
