//! The interrupt vector table.

use crate::interrupts::{ETHERNET, TIMER_0, TIMER_1, UARTS};
use crate::{clock, ethernet, uart};

/// Size of the table; the highest interrupt in use is 21.
const INTERRUPTS: usize = 32;

type Handler = extern "C" fn();

/// Used by the processor; cortex-m-rt places it after the exception vectors.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [Handler; INTERRUPTS] = {
    let mut table: [Handler; INTERRUPTS] = [unexpected; INTERRUPTS];
    table[TIMER_0.0 as usize] = clock::on_timer;
    table[TIMER_1.0 as usize] = uart::on_idle;
    table[ETHERNET.0 as usize] = ethernet::on_interrupt;
    let receive: [Handler; uart::COUNT] = [
        uart::on_receive::<0>,
        uart::on_receive::<1>,
        uart::on_receive::<2>,
        uart::on_receive::<3>,
        uart::on_receive::<4>,
    ];
    let transmit: [Handler; uart::COUNT] = [
        uart::on_transmit::<0>,
        uart::on_transmit::<1>,
        uart::on_transmit::<2>,
        uart::on_transmit::<3>,
        uart::on_transmit::<4>,
    ];
    let mut index = 0;
    while index < uart::COUNT {
        table[UARTS[index].0 as usize] = receive[index];
        table[UARTS[index].0 as usize + 1] = transmit[index];
        index += 1;
    }
    table
};

extern "C" fn unexpected() {
    panic!("an interrupt that nobody enabled");
}
