//! What must be set for a peripheral to work, and is easily forgotten: the bit of RCC that gives its clock (RM0090, 7.3; RM0410, 5.3; RM0433, 8.7),
//! and the alternate functions of its pins (the data sheets' tables of alternate functions).

use crate::chip::{Device, Family};
use crate::gpio::Pin;

/// Register and bit of RCC that give a peripheral its clock; `offset` is that of the access.
pub(crate) fn clock(family: Family, device: Device, offset: u32) -> Option<(u32, u32)> {
    // Of AHB1 (AHB2's is the next one), of the ports, of the slower and the faster bus.
    let [ahb, ports, slow, fast] =
        if family == Family::H7 { [0xd8, 0xe0, 0xe8, 0xf0] } else { [0x30, 0x30, 0x40, 0x44] };
    let h7 = family == Family::H7;
    Some(match device {
        Device::Gpio => (ports, offset / 0x400),
        Device::Dma(nth) => (ahb, nth as u32 + if h7 { 0 } else { 21 }),
        // DMAMUX1 has the clock of DMA1 and DMA2.
        Device::Dmamux => (ahb, 0),
        Device::Ethernet => (ahb, if h7 { 15 } else { 25 }),
        Device::Timer => (slow, 3),
        Device::Uart(uart) => [(slow, 17), (fast, 5), (slow, 19), (slow, 20), (slow, 18)][uart],
        Device::Spi => (fast, 12),
        Device::Syscfg if h7 => (0xf4, 1),
        Device::Syscfg => (fast, 14),
        Device::Pwr if !h7 => (slow, 28),
        Device::Random => (ahb + 4, 6),
        _ => return None,
    })
}

/// A pin and its alternate function.
pub(crate) type Function = (Pin, u32);

/// Pins of port `'A'` to `'K'`.
const fn pin(port: char, number: u32) -> Pin {
    (port as usize - 'A' as usize, number)
}

/// The pins that a UART receives by, transmits by and switches the driver by, as the boards' connectors have them.
pub(crate) fn uart(family: Family, uart: usize) -> (Function, Function, Option<Function>) {
    let h7 = family == Family::H7;
    // USART6 and the driver of UART5 are elsewhere on the H7.
    let sixth = if h7 { 7 } else { 8 };
    let fifth = if h7 { 8 } else { 7 };
    let (receive, transmit, driver) = match uart {
        0 => ((pin('D', 6), 7), (pin('D', 5), 7), Some((pin('D', 4), 7))),
        1 => ((pin('C', 7), sixth), (pin('C', 6), sixth), Some((pin('G', 12), sixth))),
        2 => ((pin('C', 11), 8), (pin('C', 10), 8), Some((pin('A', 15), 8))),
        3 => ((pin('D', 2), 8), (pin('C', 12), 8), Some((pin('C', 8), fifth))),
        _ => ((pin('D', 9), 7), (pin('D', 8), 7), None),
    };
    // The UARTs of the F4 cannot switch a driver: a plain output does.
    (receive, transmit, driver.filter(|_| family != Family::F4))
}

/// The pins of SPI1: clock, output, input.
pub(crate) const SPI: [Function; 3] = [(pin('A', 5), 5), (pin('B', 5), 5), (pin('A', 6), 5)];

/// The pins of the Ethernet's RMII and of the PHY's management.
pub(crate) const ETHERNET: [Function; 9] = [
    (pin('A', 1), 11),
    (pin('A', 7), 11),
    (pin('C', 4), 11),
    (pin('C', 5), 11),
    (pin('G', 13), 11),
    (pin('B', 13), 11),
    (pin('G', 11), 11),
    (pin('A', 2), 11),
    (pin('C', 1), 11),
];
