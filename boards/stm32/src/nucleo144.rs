//! A NUCLEO-144: its UARTs, pins and DMA channels, the same on all of these boards. See boards/README.md for the connectors.

use cortex_m::peripheral::SCB;
use embassy_executor::Spawner;
use embassy_stm32::flash::Flash;
use embassy_stm32::gpio::{Input, Pull};
use embassy_stm32::uid::uid;
use embassy_stm32::usart::Uart;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{Peripherals, pac, peripherals as p};
use embassy_sync::mutex::Mutex;
use mobgate::settings::{LineSettings, Parity};
use mobgate_firmware::console::{self, Terminal};
use mobgate_firmware::gateway::PORTS;
use mobgate_firmware::lines::{LINES, Line, Lines, SharedLine};
use mobgate_firmware::network::{Network, Runner};
use mobgate_firmware::system::Board;
use mobgate_firmware::{gateway, network, start, watchdog};
use mobgate_image::Info;
use static_cell::StaticCell;

use crate::ethernet::{LateEthernet, Parts};
use crate::flash::{ChipFlash, SharedFlash, settings, updater};
use crate::interrupts::Interrupts;
use crate::lights::Lights;
use crate::line::{Dma, UartLine, first_config};
use crate::{clock, registers};

/// Reset after this time without feeding. Erasing a sector of an F7 takes 2 s (4 s at worst), and everything stalls meanwhile. The
/// watchdog has its own oscillator, which may run a third fast.
const WATCHDOG_US: u32 = 10_000_000;
/// The console is on the ST-LINK's virtual COM port.
const CONSOLE: LineSettings = LineSettings { baud: 115_200, parity: Parity::None, ..LineSettings::DEFAULT };

static SHARED: StaticCell<[SharedLine<UartLine>; LINES]> = StaticCell::new();

/// Line `$number` of the peripherals `$p`: its UART, its receive and transmit pins, the DMA channels for both, of the receiver's also
/// controller and stream, and the pin that switches the transceiver's driver.
macro_rules! line {
    ($p:ident, $number:literal, $uart:ident, $receive:ident, $transmit:ident, $from:ident $dma:ident $stream:literal, $to:ident) => {
        line!(@ $p, $number, $uart, $from $dma $stream, $to, None,
            Uart::new_blocking($p.$uart, $p.$receive, $p.$transmit, first_config()))
    };
    ($p:ident, $number:literal, $uart:ident, $receive:ident, $transmit:ident, $from:ident $dma:ident $stream:literal, $to:ident, $driver:ident) => {{
        // The F4's UARTs cannot switch a driver.
        #[cfg(feature = "f4")]
        let line = {
            use embassy_stm32::gpio::{Level, Output, Speed};
            line!(@ $p, $number, $uart, $from $dma $stream, $to, Some(Output::new($p.$driver, Level::Low, Speed::High)),
                Uart::new_blocking($p.$uart, $p.$receive, $p.$transmit, first_config()))
        };
        #[cfg(not(feature = "f4"))]
        let line = line!(@ $p, $number, $uart, $from $dma $stream, $to, None,
            Uart::new_blocking_with_de($p.$uart, $p.$receive, $p.$transmit, $p.$driver, first_config()));
        line
    }};
    (@ $p:ident, $number:literal, $uart:ident, $from:ident $dma:ident $stream:literal, $to:ident, $driver:expr, $setup:expr) => {
        UartLine::new($number, $setup, pac::$uart, Dma::new::<p::$uart, _, _>($p.$from, pac::$dma.st($stream), $p.$to, Interrupts), $driver)
    };
}

/// Runs the gateway on the board that `info` names, with the clocks set up.
pub async fn run(spawner: Spawner, info: &'static Info, p: Peripherals) -> ! {
    clock::start();
    // On the H7, watchdogs are numbered by core.
    #[cfg(feature = "h7")]
    let watchdog = p.IWDG1;
    #[cfg(not(feature = "h7"))]
    let watchdog = p.IWDG;
    let mut watchdog = IndependentWatchdog::new(watchdog, WATCHDOG_US);
    // Before anything that may hang.
    watchdog.unleash();
    registers::prepare_memories();
    // F4 chips before revision 3 misread bank 2 unless PA12 is held low (errata 2.2.11).
    #[cfg(feature = "f4")]
    let _held_low = {
        use embassy_stm32::gpio::{Level, OutputOpenDrain, Speed};
        OutputOpenDrain::new_pull(p.PA12, Level::Low, Speed::Low, Pull::Down)
    };
    let mut lights = Lights::new(p.PB0.into(), p.PB7.into(), p.PB14.into());
    // Pressed, it connects the pin to 3.3 V.
    let button = Input::new(p.PC13, Pull::Down);
    let forget = start::is_held(|| button.is_high(), &mut lights).await;

    let lines = [
        line!(p, 0, USART2, PD6, PD5, DMA1_CH5 DMA1 5, DMA1_CH6, PD4),
        line!(p, 1, USART6, PC7, PC6, DMA2_CH1 DMA2 1, DMA2_CH6, PG12),
        line!(p, 2, UART4, PC11, PC10, DMA1_CH2 DMA1 2, DMA1_CH4, PA15),
        line!(p, 3, UART5, PD2, PC12, DMA1_CH0 DMA1 0, DMA1_CH7, PC8),
    ];
    let lines = Lines(SHARED.init(lines.map(SharedLine::new)));
    let terminal = line!(p, 4, USART3, PD9, PD8, DMA1_CH1 DMA1 1, DMA1_CH3);

    let ethernet = Parts {
        eth: p.ETH,
        clock: p.PA1,
        carrier: p.PA7,
        receive: (p.PC4, p.PC5),
        transmit: (p.PG13, p.PB13, p.PG11),
        management: (p.ETH_SMA, p.PA2, p.PC1),
    };
    let (network, runner) = network::start(spawner, LateEthernet::new(ethernet), &uid());
    let board = Board::new(info.board(), network, registers::reset_cause(), SCB::sys_reset);
    spawn(spawner, runner, lines, network);
    // Images without EtherCAT are smaller, see Cargo.toml.
    #[cfg(feature = "ethercat")]
    {
        let bus = ((p.SPI1, p.PA5, p.PB5, p.PA6), (p.DMA2_CH3, p.DMA2_CH0), p.PD14);
        let signals = ((p.PD15, p.EXTI15), (p.PF12, p.EXTI12), (p.PF13, p.EXTI13));
        crate::ethercat::start(spawner, crate::ethercat::Wires::new(bus, signals, Interrupts));
    }
    // One bank, see `flash`.
    #[cfg(feature = "f7")]
    let flash = Flash::new_blocking(p.FLASH);
    #[cfg(not(feature = "f7"))]
    let flash = Flash::new(p.FLASH, Interrupts);
    // Spawned once: the task slot is free.
    spawner.spawn(serve(board, terminal, ChipFlash::new(flash), info, forget).unwrap());
    watchdog::watch(|| watchdog.pet(), &mut lights, network).await
}

/// Starts the stack, the gateway and its ports.
fn spawn(spawner: Spawner, runner: Runner<LateEthernet>, lines: Lines<UartLine>, network: Network) {
    // Each pool has room for the tasks spawned here, and this runs once: no `unwrap` can fail.
    spawner.spawn(stack(runner).unwrap());
    gateway::start(spawner, network);
    for index in 0..PORTS {
        spawner.spawn(port(index, lines, network).unwrap());
    }
}

impl Terminal for UartLine {}

#[embassy_executor::task]
async fn stack(mut runner: Runner<LateEthernet>) -> ! {
    network::stack(&mut runner).await
}

#[embassy_executor::task(pool_size = PORTS)]
async fn port(index: usize, lines: Lines<UartLine>, network: Network) -> ! {
    gateway::port(index, lines, network).await
}

#[embassy_executor::task]
async fn serve(
    mut board: Board,
    mut terminal: UartLine,
    flash: ChipFlash,
    info: &'static Info,
    forget: bool,
) -> ! {
    // Every chip supports this format. Only the error's kind, because formatting its hint would pull the Unicode tables (3 KiB)
    // into the image.
    terminal.configure(&CONSOLE).map_err(|error| error.kind).unwrap();
    #[cfg(feature = "users")] // Images without them are smaller, see Cargo.toml.
    board.set_random(crate::random::fill);
    let flash = SharedFlash::new(flash);
    let firmware = Mutex::new(updater(&flash, *info));
    console::run(&mut board, &mut terminal, settings(&flash), 0, &firmware, forget).await
}
