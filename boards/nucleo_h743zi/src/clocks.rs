//! The clock tree of the board.

use embassy_stm32::Config;
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllDiv, PllMul, PllPreDiv, PllSource, Sysclk, VoltageScale,
};
use embassy_stm32::time::Hertz;

/// 400 MHz, which every revision of the chip can, from the 8 MHz of the ST-LINK.
pub(crate) fn config() -> Config {
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
