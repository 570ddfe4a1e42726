//! The clock tree of the board.

use embassy_stm32::Config;
use embassy_stm32::rcc::{APBPrescaler, Hse, HseMode, Pll, PllMul, PllPDiv, PllPreDiv, PllSource, Sysclk};
use embassy_stm32::time::Hertz;

/// 168 MHz, the most without overdrive, from the 8 MHz of the ST-LINK.
pub(crate) fn config() -> Config {
    let mut config = Config::default();
    config.rcc.hse = Some(Hse { freq: Hertz(8_000_000), mode: HseMode::Bypass });
    config.rcc.pll_src = PllSource::HSE;
    let (prediv, mul, divp) = (PllPreDiv::DIV4, PllMul::MUL168, Some(PllPDiv::DIV2));
    config.rcc.pll = Some(Pll { prediv, mul, divp, divq: None, divr: None });
    config.rcc.sys = Sysclk::PLL1_P;
    (config.rcc.apb1_pre, config.rcc.apb2_pre) = (APBPrescaler::DIV4, APBPrescaler::DIV2);
    config
}
