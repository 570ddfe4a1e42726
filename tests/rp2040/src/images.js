// Images in the flash, as the program and the boot loader leave them: the partitions are those of boards/w5500_evb_pico/regions.x.
import { createHash, createPrivateKey, sign } from 'node:crypto';
import { readFileSync } from 'node:fs';

const REGIONS = readFileSync(new URL('../../../boards/w5500_evb_pico/regions.x', import.meta.url), 'latin1');
/** The key of `cargo xtask board`. */
const KEY = process.env.MOBGATE_SIGNING_KEY ?? new URL('../../../target/development.key', import.meta.url);
const FLASH = 0x10000000;
/** Where a firmware has its info block, and in it the version. */
const VERSION = 0x418;
/** boards/rp_boot/src/flash.rs. */
const WORD = 32, PAGE = 32 * 1024;
/** embassy-boot's mark of an image that waits. */
const SWAP = 0xf0;

function region(name) {
  const [, origin, length] = REGIONS.match(new RegExp(`${name} +: ORIGIN = (\\w+), LENGTH = (\\d+)K`));
  return [Number(origin) - FLASH, Number(origin) - FLASH + Number(length) * 1024];
}

const [ACTIVE, UPDATE, STATE] = ['ACTIVE', 'UPDATE', 'STATE'].map(region);
/** Operations of the flash that copy a page: its erases, what is written, and a word of the state. */
export const PAGE_OPERATIONS = PAGE / 4096 + PAGE / 256 + 1;

/** The program's part of the flash. */
export function program(flash) {
  return Buffer.from(flash.bytes.subarray(...ACTIVE));
}

/** The program with another name of the board, by which it is known. */
export function renamed(image, from, to) {
  const changed = Buffer.from(image);
  for (let at = changed.indexOf(from); at >= 0; at = changed.indexOf(from)) changed.write(to, at, 'latin1');
  if (changed.equals(image)) throw new Error(`no ${from} in the image`);
  return changed;
}

/** The program, which begins by waiting for ever. */
export function hanging(image) {
  const changed = Buffer.from(image);
  const start = (changed.readUInt32LE(4) & ~1) - FLASH - ACTIVE[0];
  changed.writeUInt16LE(0xbf30, start); // wfi
  changed.writeUInt16LE(0xe7fd, start + 2); // b start
  return changed;
}

/** Puts `image` where an update waits, and marks it, as a program that has received it does. */
export function stage(flash, image) {
  flash.bytes.set(image, UPDATE[0]);
  flash.bytes.fill(0xff, ...STATE).fill(SWAP, STATE[0], STATE[0] + WORD);
}

/** The update file of a firmware: the header by mobgate-image, signed with the key that the image trusts. */
export function signed(firmware) {
  const seed = Buffer.from(readFileSync(KEY, 'latin1').trim(), 'hex');
  const prefix = Buffer.from('302e020100300506032b657004220420', 'hex'); // PKCS 8, RFC 8410
  const key = createPrivateKey({ key: Buffer.concat([prefix, seed]), format: 'der', type: 'pkcs8' });
  const header = Buffer.from('MOBGATE\x01\0\0\0\0', 'latin1');
  header.writeUInt32LE(firmware.length, 8);
  return Buffer.concat([header, sign(null, createHash('sha512').update(firmware).digest(), key), firmware]);
}

/** The program as if it were of version 0.`minor`.`patch`, where it says 0.1.0, up to its end. */
export function ofVersion(image, minor, patch) {
  const end = image.findLastIndex((byte) => byte !== 0xff) + 1;
  const other = renamed(image.subarray(0, Math.ceil(end / 4) * 4), '0.1.0', `0.${minor}.${patch}`);
  other.writeUInt16LE(minor, VERSION + 2);
  other.writeUInt16LE(patch, VERSION + 4);
  return other;
}
