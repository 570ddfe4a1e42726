// Reads a UF2 file (github.com/microsoft/uf2) into a flash, and checks what the chip's ROM checks.

const BLOCK = 512, FLASH = 0x10000000;
const RP2040_FAMILY = 0xe48bff56, HAS_FAMILY = 0x2000;

export function loadUf2(file, flash) {
  const view = new DataView(file.buffer, file.byteOffset, file.byteLength);
  const blocks = file.length / BLOCK;
  for (let number = 0; number < blocks; number++) {
    const word = (offset) => view.getUint32(number * BLOCK + offset, true);
    const [first, second, last] = [word(0), word(4), word(508)];
    if (first !== 0x0a324655 || second !== 0x9e5d5157 || last !== 0x0ab16f30) throw new Error(`block ${number}: magic`);
    if (!(word(8) & HAS_FAMILY) || word(28) !== RP2040_FAMILY) throw new Error(`block ${number}: family`);
    if (word(20) !== number || word(24) !== blocks) throw new Error(`block ${number}: numbers`);
    if (word(16) !== 256 || word(12) % 256) throw new Error(`block ${number}: not a page`);
    flash.set(file.subarray(number * BLOCK + 32, number * BLOCK + 32 + 256), word(12) - FLASH);
  }
  // The ROM starts a second stage only if its check sum is right (RP2040 data sheet 2.8.1.3.1).
  let crc = 0xffffffff;
  for (const byte of flash.subarray(0, 252)) {
    crc ^= byte << 24;
    for (let bit = 0; bit < 8; bit++) crc = crc & 0x80000000 ? (crc << 1) ^ 0x04c11db7 : crc << 1;
  }
  if (crc >>> 0 !== new DataView(flash.buffer).getUint32(252, true)) throw new Error('second stage: check sum');
}
