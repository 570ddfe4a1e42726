//! mobgate on a NUCLEO-H743ZI or -H743ZI2: its clock tree. The rest is common to the NUCLEO-144 boards.
#![no_std]
#![no_main]

use embassy_executor::Spawner;
use embassy_stm32::Config;
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllDiv, PllMul, PllPreDiv, PllSource, Sysclk, VoltageScale,
};
use embassy_stm32::time::Hertz;
use mobgate_stm32::nucleo144;

// The linker's memory maps: a change must relink the image.
const _: (&[u8], &[u8]) = (include_bytes!("../regions.x"), include_bytes!("../../../memory.x"));

mobgate_image::info!(INFO, "NUCLEO-H743ZI");

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    nucleo144::run(spawner, &INFO, embassy_stm32::init(clocks())).await
}

/// 400 MHz, which every revision of the chip supports, from the 8 MHz of the ST-LINK.
fn clocks() -> Config {
    let mut config = Config::default();
    config.rcc.hse = Some(Hse { freq: Hertz(8_000_000), mode: HseMode::Bypass });
    let (source, prediv, mul, divp) = (PllSource::HSE, PllPreDiv::DIV1, PllMul::MUL100, Some(PllDiv::DIV2));
    // 100 MHz for the SPI.
    let divq = Some(PllDiv::DIV8);
    config.rcc.pll1 = Some(Pll { source, prediv, mul, fracn: None, divp, divq, divr: None });
    config.rcc.sys = Sysclk::PLL1_P;
    config.rcc.ahb_pre = AHBPrescaler::DIV2;
    (config.rcc.apb1_pre, config.rcc.apb2_pre) = (APBPrescaler::DIV2, APBPrescaler::DIV2);
    (config.rcc.apb3_pre, config.rcc.apb4_pre) = (APBPrescaler::DIV2, APBPrescaler::DIV2);
    config.rcc.voltage_scale = VoltageScale::Scale1;
    config
}
