//! mobgate on a NUCLEO-H743ZI or -H743ZI2: the hardware, the gateway, the tasks. boards/README.md has the connectors.
#![no_std]
#![no_main]

mod clocks;

use embassy_executor::Spawner;
use embassy_stm32::eth::{self, Ethernet};
use embassy_stm32::flash::{self, Flash};
use embassy_stm32::gpio::{Input, Pull};
use embassy_stm32::interrupt::typelevel;
use embassy_stm32::usart::{Config as Serial, Uart};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{bind_interrupts, dma, exti, pac, peripherals as p};
use mobgate_stm32::flash::SettingsFlash;
use mobgate_stm32::lights::Lights;
use mobgate_stm32::line::{Dma, Line, LineInterrupt, RING_BYTES};
use mobgate_stm32::lines::{Lines, Place};
use mobgate_stm32::system::Board;
use mobgate_stm32::{console, gateway, network, watchdog};
use static_cell::{ConstStaticCell, StaticCell};

// The linker's maps: a changed one links anew.
const _: (&[u8], &[u8]) = (include_bytes!("../regions.x"), include_bytes!("../../../memory.x"));

bind_interrupts!(struct Interrupts {
    USART2 => LineInterrupt<0>;
    USART6 => LineInterrupt<1>;
    UART4 => LineInterrupt<2>;
    UART5 => LineInterrupt<3>;
    USART3 => LineInterrupt<4>;
    DMA1_STREAM0 => dma::InterruptHandler<p::DMA1_CH0>;
    DMA1_STREAM1 => dma::InterruptHandler<p::DMA1_CH1>;
    DMA1_STREAM2 => dma::InterruptHandler<p::DMA1_CH2>;
    DMA1_STREAM3 => dma::InterruptHandler<p::DMA1_CH3>;
    DMA1_STREAM4 => dma::InterruptHandler<p::DMA1_CH4>;
    DMA1_STREAM5 => dma::InterruptHandler<p::DMA1_CH5>;
    DMA1_STREAM6 => dma::InterruptHandler<p::DMA1_CH6>;
    DMA1_STREAM7 => dma::InterruptHandler<p::DMA1_CH7>;
    DMA2_STREAM1 => dma::InterruptHandler<p::DMA2_CH1>;
    DMA2_STREAM6 => dma::InterruptHandler<p::DMA2_CH6>;
    DMA2_STREAM0 => dma::InterruptHandler<p::DMA2_CH0>;
    DMA2_STREAM3 => dma::InterruptHandler<p::DMA2_CH3>;
    EXTI15_10 => exti::InterruptHandler<typelevel::EXTI15_10>;
    ETH => eth::InterruptHandler;
    FLASH => flash::InterruptHandler;
});

static RINGS: ConstStaticCell<[[u8; RING_BYTES]; 5]> = ConstStaticCell::new([[0; RING_BYTES]; 5]);
static LINES: StaticCell<[Place; 4]> = StaticCell::new();

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let p = embassy_stm32::init(clocks::config());
    let mut lights = Lights::new(p.PB0.into(), p.PB7.into(), p.PB14.into());
    let forget = lights.button_is_held(&Input::new(p.PC13, Pull::Down)).await;

    let [ring1, ring2, ring3, ring4, ring5] = RINGS.take();
    let setup = Uart::new_blocking_with_de(p.USART2, p.PD6, p.PD5, p.PD4, Serial::default());
    let dma = Dma::new::<p::USART2, _, _>(p.DMA1_CH5, p.DMA1_CH6, Interrupts);
    let one = Line::new(0, setup, pac::USART2, dma, None, ring1);
    let setup = Uart::new_blocking_with_de(p.USART6, p.PC7, p.PC6, p.PG12, Serial::default());
    let dma = Dma::new::<p::USART6, _, _>(p.DMA2_CH1, p.DMA2_CH6, Interrupts);
    let two = Line::new(1, setup, pac::USART6, dma, None, ring2);
    let setup = Uart::new_blocking_with_de(p.UART4, p.PC11, p.PC10, p.PA15, Serial::default());
    let dma = Dma::new::<p::UART4, _, _>(p.DMA1_CH2, p.DMA1_CH4, Interrupts);
    let three = Line::new(2, setup, pac::UART4, dma, None, ring3);
    let setup = Uart::new_blocking_with_de(p.UART5, p.PD2, p.PC12, p.PC8, Serial::default());
    let dma = Dma::new::<p::UART5, _, _>(p.DMA1_CH0, p.DMA1_CH7, Interrupts);
    let four = Line::new(3, setup, pac::UART5, dma, None, ring4);
    let lines = Lines(LINES.init([one, two, three, four].map(Place::new)));
    let setup = Uart::new_blocking(p.USART3, p.PD9, p.PD8, Serial::default());
    let dma = Dma::new::<p::USART3, _, _>(p.DMA1_CH1, p.DMA1_CH3, Interrupts);
    let terminal = Line::new(4, setup, pac::USART3, dma, None, ring5);

    let (packets, address) = (network::PACKET_QUEUE.take(), network::ethernet_address());
    let ethernet = Ethernet::new(
        packets, p.ETH, Interrupts, p.PA1, p.PA7, p.PC4, p.PC5, p.PG13, p.PB13, p.PG11, address, p.ETH_SMA,
        p.PA2, p.PC1,
    );

    let network = network::start(spawner, ethernet);
    let board = Board::new("NUCLEO-H743ZI", network);
    gateway::start(spawner, lines, network);
    // Images without EtherCAT are smaller, see Cargo.toml.
    #[cfg(feature = "ethercat")]
    mobgate_stm32::ethercat::start(
        spawner,
        mobgate_stm32::ethercat::Wires::new(
            p.SPI1, p.PA5, p.PB5, p.PA6, p.DMA2_CH3, p.DMA2_CH0, p.PD14, p.PD15, p.EXTI15, Interrupts,
        ),
    );
    console::start(spawner, board, terminal, SettingsFlash::new(Flash::new(p.FLASH, Interrupts)), forget);
    watchdog::watch(IndependentWatchdog::new(p.IWDG1, watchdog::TIMEOUT_US), lights, network).await
}
