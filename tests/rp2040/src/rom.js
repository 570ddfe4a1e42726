// The functions of the RP2040's ROM that the image calls (RP2040 data sheet 2.8.3): each is a breakpoint, and done here.
// While the flash is not mapped the program must run from elsewhere, with interrupts off.

const LOOKUP = 0x100;
/** The ROM talks to the flash bit by bit, at a sixth of the system clock; before that it waits for pull-ups (its source: BAUDR, `flash_exit_xip`). */
const CLOCKS_PER_BYTE = 8 * 6, CLOCKS_OF_EXIT = 2 * 2048 * 3;
const FUNCTIONS = ['lookup', 'IF', 'EX', 'RE', 'RP', 'FC', 'CX', 'C4', 'MC', 'MS', 'S4'];

export function loadRom(chip, board) {
  const rom = new Uint16Array(chip.bootrom.buffer);
  rom[0x14 / 2] = 0x80;
  rom[0x18 / 2] = LOOKUP | 1;
  FUNCTIONS.forEach((_, number) => {
    rom[(LOOKUP + number * 4) / 2] = 0xbe00 | number;
    rom[(LOOKUP + number * 4) / 2 + 1] = 0x4770; // bx lr
  });
  const { core } = chip;
  const { flash } = board;
  const inFlash = (address) => address >>> 24 === 0x10;
  const stall = (nanos) => {
    if (flash.mapped) flash.faults.push('the flash is still mapped');
    if (!core.PM) flash.faults.push('interrupts are on while the flash is busy');
    if (inFlash(core.LR)) flash.faults.push('called from the flash');
    board.clock.tick(nanos);
  };
  const clocks = (count) => count * 1e9 / chip.clkSys;
  const copy = (to, from, count) => {
    for (let n = 0; n < count; n++) chip.writeUint8(to + n, chip.readUint8(from + n));
  };
  const functions = {
    lookup([, code]) {
      const name = String.fromCharCode(code & 0xff, code >> 8);
      const number = FUNCTIONS.indexOf(name);
      if (number < 0) throw new Error(`the ROM has no ${name}`);
      return (LOOKUP + number * 4) | 1;
    },
    IF() {},
    EX() { flash.mapped = false; board.clock.tick(clocks(CLOCKS_OF_EXIT)); },
    RE([address, count]) { stall(flash.erase(address, count)); },
    RP([address, data, count]) {
      const bytes = Uint8Array.from({ length: count }, (_, n) => chip.readUint8(data + n));
      stall(flash.program(address, bytes) + clocks(count * CLOCKS_PER_BYTE));
    },
    FC() { flash.mapped = true; },
    CX() { flash.mapped = true; },
    C4([to, from, count]) { copy(to, from, count); return to; },
    MC([to, from, count]) { copy(to, from, count); return to; },
    MS([to, value, count]) { for (let n = 0; n < count; n++) chip.writeUint8(to + n, value); return to; },
    S4([to, value, count]) { for (let n = 0; n < count; n++) chip.writeUint8(to + n, value); return to; },
  };
  chip.onBreak = (number) => {
    const name = FUNCTIONS[number];
    if (core.PC !== LOOKUP + number * 4 + 2 || !name) throw new Error(`breakpoint at ${core.PC.toString(16)}`);
    const result = functions[name]([...core.registers.subarray(0, 4)]);
    if (result !== undefined) core.registers[0] = result;
  };
}
