//! mobgate on a NUCLEO-F429ZI: its clock tree. The rest is common to the NUCLEO-144 boards.
#![no_std]
#![no_main]

use embassy_executor::Spawner;
use embassy_stm32::Config;
use embassy_stm32::rcc::{
    APBPrescaler, Hse, HseMode, Pll, PllMul, PllPDiv, PllPreDiv, PllQDiv, PllSource, Sysclk,
};
use embassy_stm32::time::Hertz;
use mobgate_stm32::nucleo144;

// The linker's memory maps: a change must relink the image.
const _: (&[u8], &[u8]) = (include_bytes!("../regions.x"), include_bytes!("../../../memory.x"));

mobgate_image::info!(INFO, "NUCLEO-F429ZI");

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    nucleo144::run(spawner, &INFO, embassy_stm32::init(clocks())).await
}

/// 168 MHz, the maximum without overdrive, from the 8 MHz of the ST-LINK.
fn clocks() -> Config {
    let mut config = Config::default();
    config.rcc.hse = Some(Hse { freq: Hertz(8_000_000), mode: HseMode::Bypass });
    config.rcc.pll_src = PllSource::HSE;
    let (prediv, mul, divp) = (PllPreDiv::DIV4, PllMul::MUL168, Some(PllPDiv::DIV2));
    // 48 MHz for the random numbers.
    let divq = Some(PllQDiv::DIV7);
    config.rcc.pll = Some(Pll { prediv, mul, divp, divq, divr: None });
    config.rcc.sys = Sysclk::PLL1_P;
    (config.rcc.apb1_pre, config.rcc.apb2_pre) = (APBPrescaler::DIV4, APBPrescaler::DIV2);
    config
}
