//! The programs of a PIO: a UART of any character format, whose transmitter switches the transceiver's driver.

use embassy_rp::pio::program::pio_asm;
use embassy_rp::pio::{Common, Instance, LoadedProgram};

/// Cycles of a state machine in a bit.
pub(crate) const CYCLES_PER_BIT: u32 = 16;

/// The programs, loaded into a PIO.
pub(crate) struct Programs<'d, P: Instance> {
    pub(crate) transmit: LoadedProgram<'d, P>,
    pub(crate) receive: LoadedProgram<'d, P>,
}

impl<'d, P: Instance> Programs<'d, P> {
    /// Loads both.
    pub(crate) fn load(pio: &mut Common<'d, P>) -> Self {
        // Side-set is the driver. A word has the number of bits before the last one, less one, in four bits, then the bits.
        // The driver is on for a bit before the first character and for two after the last one: a frame that is passed on while
        // it arrives has pauses of a bit where its sender's crystal is slower.
        let transmit = pio_asm!(
            ".side_set 1",
            "idle:",
            "    pull block         side 0",
            "    nop                side 1 [15]",
            ".wrap_target",
            "    out x, 4           side 1",
            "bit:",
            "    out pins, 1        side 1 [14]",
            "    jmp x-- bit        side 1",
            // The last stop bit: these 11 cycles, and 5 until the next start bit.
            "    out pins, 1        side 1 [10]",
            "    set x, 10          side 1",
            // All ones while nothing is there to send.
            "hold:",
            "    mov y, status      side 1",
            "    jmp !y more        side 1",
            "    jmp x-- hold       side 1",
            "    jmp idle           side 1",
            "more:",
            "    pull block         side 1",
            ".wrap",
        );
        // Y is the number of data and parity bits, less one. A word has them, and the first stop bit above them.
        let receive = pio_asm!(
            ".wrap_target",
            "start:",
            "    wait 0 pin 0 [7]",
            // Half a start bit: noise is over by now.
            "    jmp pin start",
            "    mov x, y [14]",
            "bit:",
            "    in pins, 1 [14]",
            "    jmp x-- bit",
            "    in pins, 1",
            "    push noblock",
            "    irq nowait 0 rel",
            "    jmp pin start",
            // A missing stop bit: the next character begins after the line was idle.
            "    wait 1 pin 0",
            ".wrap",
        );
        Self { transmit: pio.load_program(&transmit.program), receive: pio.load_program(&receive.program) }
    }
}
