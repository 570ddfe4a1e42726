// A W25Q16JV: sectors of 4 KiB that are erased to ones, pages of 256 bytes whose bits can only be cleared, a unique number. What
// the RP2040's ROM does with it takes the time of the data sheet.

export const BYTES = 2 * 1024 * 1024;
const SECTOR = 4096, PAGE = 256;
/** Typical times (W25Q16JV data sheet 9.6). */
const ERASE_NANOS = 45e6, PROGRAM_NANOS = 0.4e6;
const UNIQUE = [0xe6, 0x61, 0x64, 0x08, 0x43, 0x6d, 0x5b, 0x2a];
const READ_UNIQUE = 0x4b;

export class Flash {
  constructor() {
    // rp2040js maps 16 MiB. What is beyond this chip's flash is looked at after a test.
    this.bytes = new Uint8Array(16 * 1024 * 1024).fill(0xff);
    this.erases = 0;
    this.operations = 0;
    /** Operations until the power fails. */
    this.left = Infinity;
    this.onFail = () => {};
    this.faults = [];
    /** Whether the chip can execute from it. */
    this.mapped = true;
  }

  attach(chip) {
    this.mapped = true;
    this.powered = true;
    const ssi = chip.peripherals[0x18000];
    const [read, write] = [ssi.readUint32.bind(ssi), ssi.writeUint32.bind(ssi)];
    let command, read_so_far;
    ssi.writeUint32 = (offset, value) => {
      if (offset === 0x08) command = undefined;
      if (offset === 0x60 && command === undefined) [command, read_so_far] = [value & 0xff, 0];
      write(offset, value);
    };
    ssi.readUint32 = (offset) => {
      // Four dummy bytes, then the number.
      if (offset === 0x60 && command === READ_UNIQUE) return UNIQUE[read_so_far++ - 4] ?? 0;
      return read(offset);
    };
  }

  /** The power fails in the middle of operation `nth` from now; `anything` gives what is left in a byte. */
  failAt(nth, anything) {
    Object.assign(this, { left: nth, anything });
  }

  /** Counts an operation, an erase of a sector or a page that is programmed; says whether the power fails in it. */
  fails() {
    this.operations++;
    this.powered = this.left-- !== 0;
    if (!this.powered) this.onFail();
    return !this.powered;
  }

  /** Erases; returns the time it takes. */
  erase(address, length) {
    if (address % SECTOR || length % SECTOR || address + length > BYTES) this.faults.push(`erase ${address}+${length}`);
    for (let at = address; at < address + length && this.powered; at += SECTOR) {
      const sector = this.bytes.subarray(at, at + SECTOR);
      // Its bits are cleared before they are set: what is left may be anything.
      if (this.fails()) sector.forEach((_, n) => { sector[n] = this.anything(); });
      else sector.fill(0xff);
      this.erases++;
    }
    return length / SECTOR * ERASE_NANOS;
  }

  /** Programs; returns the time it takes. */
  program(address, bytes) {
    if (address % PAGE || bytes.length % PAGE || address + bytes.length > BYTES) this.faults.push(`program ${address}+${bytes.length}`);
    for (let at = 0; at < bytes.length && this.powered; at += PAGE) {
      const fails = this.fails();
      bytes.subarray(at, at + PAGE).forEach((byte, n) => {
        this.bytes[address + at + n] &= fails ? byte | this.anything() : byte;
      });
    }
    return bytes.length / PAGE * PROGRAM_NANOS;
  }
}
