//! The F767's flash has to be one bank, as it is delivered: where images, pages and settings lie depends on it.

use embassy_stm32::pac::gpio::vals::Moder;
use embassy_stm32::pac::usart::regs::Brr;
use embassy_stm32::pac::{FLASH, GPIOD, RCC, USART3};

use crate::watchdog;

/// Of the oscillator that the chip starts with.
const CLOCK_HZ: u32 = 16_000_000;
const BAUD: u32 = 115_200;
/// PD8, the console's transmitter, by its number in its port, in the upper half of a port, and its function.
const PIN: (usize, usize, u8) = (8, 0, 7);
const TEXT: &[u8] = b"mobgate needs this chip's flash in one bank: STM32_Programmer_CLI -c port=SWD -ob nDBANK=1, then flash it anew\r\n";

/// Goes on where it is one bank. Else it says so at the console, again and again: embassy-stm32's driver of the flash would end in a panic, here and
/// at each further start. The chip's clocks are those of the reset.
pub(crate) fn check() {
    if FLASH.optcr().read().n_dbank() {
        return;
    }
    RCC.ahb1enr().modify(|enabled| enabled.set_gpioden(true));
    RCC.apb1enr().modify(|enabled| enabled.set_usart3en(true));
    // Two cycles pass until they have their clocks (errata 2.1.6).
    RCC.apb1enr().read();
    let (pin, nth, function) = PIN;
    GPIOD.afr(1).modify(|functions| functions.set_afr(nth, function));
    GPIOD.moder().modify(|modes| modes.set_moder(pin, Moder::ALTERNATE));
    USART3.brr().write_value(Brr((CLOCK_HZ + BAUD / 2) / BAUD));
    USART3.cr1().write(|control| {
        control.set_ue(true);
        control.set_te(true);
    });
    loop {
        watchdog::feed();
        for &byte in TEXT {
            while !USART3.isr().read().txe() {}
            USART3.tdr().write(|data| data.set_dr(byte.into()));
        }
        cortex_m::asm::delay(CLOCK_HZ);
    }
}
