//! Registers that differ between the families: the F4's USARTs are of an older generation, and the H7 records resets elsewhere.

use embassy_stm32::pac::usart::Usart;
use mobgate::hal::Flaws;

/// The register from which DMA reads received characters.
pub(crate) fn receive_address(uart: Usart) -> *mut u8 {
    // The F4 has one register for both directions.
    #[cfg(feature = "f4")]
    return uart.dr().as_ptr().cast();
    #[cfg(not(feature = "f4"))]
    return uart.rdr().as_ptr().cast();
}

/// The register to which DMA writes characters.
pub(crate) fn transmit_address(uart: Usart) -> *mut u8 {
    // The F4 has one register for both directions.
    #[cfg(feature = "f4")]
    return uart.dr().as_ptr().cast();
    #[cfg(not(feature = "f4"))]
    return uart.tdr().as_ptr().cast();
}

// The status register has another name.
#[cfg(not(feature = "f4"))]
pub(crate) use embassy_stm32::pac::usart::regs::Isr as State;
#[cfg(feature = "f4")]
pub(crate) use embassy_stm32::pac::usart::regs::Sr as State;

/// Reads the flags.
pub(crate) fn state(uart: Usart) -> State {
    #[cfg(feature = "f4")]
    return uart.sr().read();
    #[cfg(not(feature = "f4"))]
    return uart.isr().read();
}

/// The last character received, which DMA has taken already: reading it again changes nothing.
pub(crate) fn received(uart: Usart) -> u8 {
    // SAFETY: the register is always valid.
    unsafe { receive_address(uart).read_volatile() }
}

/// Sends a character; the transmitter must have room (TXE).
pub(crate) fn send(uart: Usart, byte: u8) {
    // SAFETY: as above.
    unsafe { transmit_address(uart).write_volatile(byte) }
}

/// Clears the transmission-complete flag without touching flags that may be set meanwhile.
pub(crate) fn forget_transmitted(uart: Usart) {
    // The F4's flags are cleared by writing zeros and kept by ones. A read-modify-write would clear RXNE of a character that
    // arrives in between.
    #[cfg(feature = "f4")]
    uart.sr().write(|flags| {
        flags.0 = u32::MAX;
        flags.set_tc(false);
    });
    #[cfg(not(feature = "f4"))]
    uart.icr().write(|flags| flags.set_tc(true));
}

/// Clears the flags in `status` of the character just received and of the silence before it, and returns its flaws.
pub(crate) fn take_flaws(uart: Usart, status: State) -> Flaws {
    // The F4 clears its flags when the status and then the character are read. DMA reads the character, so its flags may be cleared
    // with the next one's, and of two bad characters in a row one may be counted. An overrun would interrupt for ever; its
    // character is lost already, so it is read here.
    #[cfg(feature = "f4")]
    if status.ore() {
        let _ = uart.dr().read();
    }
    // Newer USARTs do not detect overruns here, and have a register for clearing flags.
    #[cfg(not(feature = "f4"))]
    uart.icr().write(|flags| {
        flags.set_pe(status.pe());
        flags.set_fe(status.fe());
        flags.set_idle(status.idle());
    });
    Flaws { parity: status.pe().into(), framing: status.fe().into(), overruns: status.ore().into() }
}

/// Settings missing in embassy-stm32: reception that continues after an overrun, and separate driver times in sixteenths of a bit;
/// it uses the first one for both.
pub(crate) fn complete_setup(uart: Usart, before: u8, after: u8) {
    uart.cr1().modify(|control| control.set_ue(false));
    // The F4 has neither.
    #[cfg(not(feature = "f4"))]
    {
        uart.cr3().modify(|control| control.set_ovrdis(true));
        uart.cr1().modify(|control| {
            control.set_deat(before);
            control.set_dedt(after);
        });
    }
    #[cfg(feature = "f4")]
    let _ = (before, after);
    uart.cr3().modify(|control| {
        control.set_dmar(true);
        control.set_dmat(true);
    });
    uart.cr1().modify(|control| {
        control.set_ue(true);
        control.set_rxneie(true);
    });
}

/// Reads and clears the cause of the chip's reset.
pub(crate) fn reset_cause() -> &'static str {
    use embassy_stm32::pac::RCC;
    // The H7 has a separate register, with a flag for each power domain's watchdog.
    #[cfg(feature = "h7")]
    let (watchdog, software, power, pin) = {
        let flags = RCC.rsr().read();
        RCC.rsr().modify(|flags| flags.set_rmvf(true));
        (
            flags.iwdg1rstf() || flags.wwdg1rstf(),
            flags.sftrstf(),
            flags.borrstf() || flags.porrstf(),
            flags.pinrstf(),
        )
    };
    #[cfg(not(feature = "h7"))]
    let (watchdog, software, power, pin) = {
        let flags = RCC.csr().read();
        RCC.csr().modify(|flags| flags.set_rmvf(true));
        let power = flags.borrstf() || flags.porrstf();
        (flags.wdgrstf() || flags.wwdgrstf(), flags.sftrstf(), power, flags.padrstf())
    };
    // Every reset also pulls the pin low, so the pin is checked last.
    match (watchdog, software, power, pin) {
        (true, ..) => "started by the watchdog",
        (_, true, ..) => "started by reboot or after a fault",
        (_, _, true, _) => "started by power",
        (_, _, _, true) => "started by the reset button or a debugger",
        _ => "started for a reason unknown",
    }
}

/// Enables caches for full speed, and works around a memory erratum of the H7.
pub(crate) fn prepare_memories() {
    // The F4's Cortex-M4 has no cache; its flash interface has one, and a prefetch, both off after a reset.
    #[cfg(feature = "f4")]
    embassy_stm32::pac::FLASH.acr().modify(|control| {
        control.set_icen(true);
        control.set_prften(true);
    });
    #[cfg(not(feature = "f4"))]
    // SAFETY: nobody else uses the SCB: embassy-stm32 keeps no part of it, and this runs once, at start-up.
    unsafe { cortex_m::Peripherals::steal() }.SCB.enable_icache();
    // Before revision X, reads of the AXI SRAM by several masters may be corrupted (errata 2.2.9): limit them to one at a time.
    #[cfg(feature = "h7")]
    if embassy_stm32::pac::DBGMCU.idc().read().rev_id() < 0x2000 {
        /// AXI_TARG7_FN_MOD (RM0433, 2.2.4), which no crate defines. Bit 0 is READ_ISS_OVERRIDE.
        const TARGET_7: *mut u32 = 0x5100_8108 as *mut u32;
        // SAFETY: every H743 has the register, and nobody else writes it.
        unsafe { TARGET_7.write_volatile(1) };
    }
}

/// Sets the MAC to 100 or 10 Mbit/s, full or half duplex.
pub(crate) fn set_ethernet_speed(is_100: bool, is_full: bool) {
    let control = embassy_stm32::pac::ETH.ethernet_mac().maccr();
    // The H7's MAC is of a newer generation.
    #[cfg(feature = "h7")]
    control.modify(|control| {
        control.set_fes(is_100);
        control.set_dm(is_full);
    });
    #[cfg(not(feature = "h7"))]
    control.modify(|control| {
        use embassy_stm32::pac::eth::vals::{Dm, Fes};
        control.set_fes(if is_100 { Fes::FES100 } else { Fes::FES10 });
        control.set_dm(if is_full { Dm::FULL_DUPLEX } else { Dm::HALF_DUPLEX });
    });
}

/// Whether the end of a packet that is sent interrupts. One that has ended before does so at once, unless an interrupt has come since.
pub(crate) fn interrupt_when_sent(on: bool) {
    let dma = embassy_stm32::pac::ETH.ethernet_dma();
    // The H7's MAC is of a newer generation.
    #[cfg(feature = "h7")]
    dma.dmacier().modify(|enabled| enabled.set_tie(on));
    #[cfg(not(feature = "h7"))]
    dma.dmaier().modify(|enabled| enabled.set_tie(on));
}
