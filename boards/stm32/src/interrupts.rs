//! Interrupt handlers of a NUCLEO-144.

use embassy_stm32::interrupt::typelevel;
use embassy_stm32::{bind_interrupts, dma, eth, exti, peripherals as p};

use crate::shift::LineInterrupt;

bind_interrupts!(pub(crate) struct Interrupts {
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
    /// One bank, see `flash`.
    #[cfg(not(feature = "f7"))]
    FLASH => embassy_stm32::flash::InterruptHandler;
});
