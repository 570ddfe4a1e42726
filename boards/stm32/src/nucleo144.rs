//! A NUCLEO-144: its UARTs, pins and DMA channels, the same on all of these boards. See boards/README.md for the connectors.

use embassy_executor::Spawner;
use embassy_stm32::flash::Flash;
use embassy_stm32::gpio::{Input, Pull};
use embassy_stm32::usart::Uart;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{Peripherals, pac, peripherals as p};
use static_cell::StaticCell;

use crate::ethernet::{LateEthernet, Parts};
use crate::flash::SettingsFlash;
use crate::interrupts::Interrupts;
use crate::lights::Lights;
use crate::line::{Dma, Line, first_config};
use crate::lines::{LINES, Lines, SharedLine};
use crate::system::Board;
use crate::{clock, console, gateway, network, registers, watchdog};

static SHARED: StaticCell<[SharedLine; LINES]> = StaticCell::new();

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
        #[cfg(not(feature = "f4"))] // As above.
        let line = line!(@ $p, $number, $uart, $from $dma $stream, $to, None,
            Uart::new_blocking_with_de($p.$uart, $p.$receive, $p.$transmit, $p.$driver, first_config()));
        line
    }};
    (@ $p:ident, $number:literal, $uart:ident, $from:ident $dma:ident $stream:literal, $to:ident, $driver:expr, $setup:expr) => {
        Line::new($number, $setup, pac::$uart, Dma::new::<p::$uart, _, _>($p.$from, pac::$dma.st($stream), $p.$to, Interrupts), $driver)
    };
}

/// Runs the gateway on the board `name`, with the clocks set up.
pub async fn run(spawner: Spawner, name: &'static str, p: Peripherals) -> ! {
    clock::start();
    // On the H7, watchdogs are numbered by core.
    #[cfg(feature = "h7")]
    let watchdog = p.IWDG1;
    #[cfg(not(feature = "h7"))] // As above.
    let watchdog = p.IWDG;
    let mut watchdog = IndependentWatchdog::new(watchdog, watchdog::TIMEOUT_US);
    // Before anything that may hang.
    watchdog.unleash();
    registers::prepare_memories();
    // F4 chips before revision 3 misread bank 2 unless PA12 is held low (errata 2.2.11).
    #[cfg(feature = "f4")]
    let _held_low = embassy_stm32::gpio::OutputOpenDrain::new_pull(
        p.PA12,
        embassy_stm32::gpio::Level::Low,
        embassy_stm32::gpio::Speed::Low,
        Pull::Down,
    );
    let mut lights = Lights::new(p.PB0.into(), p.PB7.into(), p.PB14.into());
    let forget = lights.button_is_held(&Input::new(p.PC13, Pull::Down)).await;

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
    let network = network::start(spawner, LateEthernet::new(ethernet));
    let board = Board::new(name, network);
    gateway::start(spawner, lines, network);
    // Images without EtherCAT are smaller, see Cargo.toml.
    #[cfg(feature = "ethercat")]
    crate::ethercat::start(
        spawner,
        crate::ethercat::Wires::new(
            p.SPI1, p.PA5, p.PB5, p.PA6, p.DMA2_CH3, p.DMA2_CH0, p.PD14, p.PD15, p.EXTI15, Interrupts,
        ),
    );
    // One bank, see `flash`.
    #[cfg(feature = "f7")]
    let flash = Flash::new_blocking(p.FLASH);
    #[cfg(not(feature = "f7"))] // As above.
    let flash = Flash::new(p.FLASH, Interrupts);
    console::start(spawner, board, terminal, SettingsFlash::new(flash), forget);
    watchdog::watch(watchdog, lights, network).await
}
