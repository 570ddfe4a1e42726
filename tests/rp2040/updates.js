// New firmware: what the boot loader starts, swaps and swaps back, with power cuts in between; the way in by the console, and the trial.
import assert from 'node:assert/strict';
import test from 'node:test';
import { Bench } from './src/bench.js';
import { PAGE_OPERATIONS, hanging, ofVersion, program, renamed, signed, stage } from './src/images.js';
import { send } from './src/ymodem.js';

/** How often two images are swapped and swapped back with power cuts, and what those of the first swap depend on. */
const SWAPS = Number(process.env.MOBGATE_SWAPS ?? 2), SEED = Number(process.env.MOBGATE_SEED ?? 1);
/** The longest swap, and a start. */
const START_SECONDS = 60;
/** How long the lines may rest for an update. */
const PAUSE_SECONDS = 30;
const NAME = 'W5500-EVB-Pico', OTHER_NAME = 'W5500-EVB-Picx';

function runs(bench, name) {
  assert.match(bench.boot(START_SECONDS), new RegExp(`mobgate [0-9.]+ on ${name}\\b`));
}

/** A board with saved settings, its program, and another one. */
function prepare() {
  const bench = new Bench();
  runs(bench, NAME);
  bench.gateway();
  assert.match(bench.console.command('save'), /saved/);
  const old = program(bench.board.flash);
  return { bench, board: bench.board, flash: bench.board.flash, old, other: renamed(old, NAME, OTHER_NAME) };
}

/** Numbers from 0 to 1 that `seed` decides (Marsaglia's xorshift). */
function numbers(seed) {
  let state = (seed * 0x9e3779b9) | 1;
  return () => {
    state ^= state << 13;
    state ^= state >>> 17;
    state ^= state << 5;
    return (state >>> 0) / 2 ** 32;
  };
}

test('an image that waits is swapped in, and one that is not confirmed goes back', () => {
  const { bench, board, flash, old, other } = prepare();
  stage(flash, other);
  const from = board.seconds;
  board.powerCycle();
  runs(bench, OTHER_NAME);
  const pause = board.seconds - from;
  console.log(`figure rp2040_update_pause_s ${pause.toFixed(1)} s <=${PAUSE_SECONDS} ${pause > PAUSE_SECONDS ? 'short' : 'ok'}`);
  assert.ok(pause <= PAUSE_SECONDS);
  assert.ok(program(flash).equals(other));
  board.powerCycle();
  runs(bench, NAME);
  assert.ok(program(flash).equals(old));
  assert.match(bench.console.command('show config'), /route P502 4 +\* +\* P4/);
  // It stays.
  const { operations } = flash;
  board.powerCycle();
  runs(bench, NAME);
  assert.equal(flash.operations, operations);
  assert.deepEqual(board.restarts, []);
  assert.deepEqual(bench.faults, []);
});

test('an image that hangs at its start goes back', () => {
  const { bench, board, flash, old } = prepare();
  stage(flash, hanging(old));
  board.powerCycle();
  runs(bench, NAME);
  assert.match(bench.console.command('show log'), /started by the watchdog/);
  assert.equal(board.restarts.length, 1);
  assert.ok(program(flash).equals(old));
  assert.deepEqual(bench.faults, []);
});

test('an update by the console is confirmed, and one that finds no W5500 goes back', () => {
  const { bench, board, flash, old } = prepare();
  const shows = (text) => assert.match(bench.console.command('show update'), text);
  shows(/0\.1\.0: confirmed/);
  const next = ofVersion(old, 1, 1);
  assert.match(send(bench, 'update', signed(next)), /0\.1\.1 is complete and genuine; it starts now, on trial/);
  assert.ok(program(flash).subarray(0, next.length).equals(next));
  shows(/0\.1\.1: on trial/);
  board.run(8);
  shows(/0\.1\.1: confirmed/);
  assert.match(bench.console.command('read 3 holding 5 count 2 via P3'), /3005 3006/);
  bench.w5500.present = false;
  const after = ofVersion(old, 1, 2);
  assert.match(send(bench, 'update', signed(after)), /0\.1\.2 is complete and genuine/);
  shows(/0\.1\.2: on trial/);
  assert.ok(board.run(START_SECONDS + 5, () => board.restarts.length === 3), 'it goes back');
  runs(bench, NAME);
  shows(/0\.1\.1: went back from 0\.1\.2: on trial the network's hardware was not found/);
  assert.match(bench.console.command('show config'), /route P502 4 +\* +\* P4/);
  assert.deepEqual(bench.faults, []);
});

test('what is refused is named, and what runs stays', () => {
  const { bench, flash, old } = prepare();
  const small = ofVersion(old, 1, 1).subarray(0, 4096);
  const [whole, tampered] = [signed(small), signed(small)];
  tampered[3000] ^= 1;
  for (const [file, reason] of [
    [tampered, "the image's signature is wrong"],
    [whole.subarray(0, 3500), 'the image is incomplete'],
    [signed(ofVersion(old, 0, 9).subarray(0, 4096)), 'the image is older than what runs'],
    [small, 'this is no image of mobgate'],
  ]) {
    assert.ok(send(bench, 'update', file).includes(`error: ${reason}\r\n`), reason);
    assert.match(bench.console.command('show update'), /0\.1\.0: confirmed/);
  }
  bench.board.powerCycle();
  runs(bench, NAME);
  assert.ok(program(flash).equals(old));
  assert.deepEqual(bench.faults, []);
});

/** Starts the board, with the power failing in operations that `next` counts from each start, until an image has started. */
function startWithCuts({ bench: { board, console: terminal } }, next, random) {
  board.powerCycle();
  const before = board.restarts.length;
  do {
    const cuts = board.restarts.length;
    board.flash.failAt(next(), () => Math.floor(random() * 256));
    assert.ok(board.run(START_SECONDS, () => board.restarts.length > cuts || terminal.connected));
  } while (!terminal.connected);
  board.flash.failAt(Infinity);
  return board.restarts.length - before;
}

/** Numbers of operations by `seed`: a page is copied anew after a cut, so half of the cuts come later than its end. */
function some(seed) {
  const random = numbers(seed);
  return { name: `seed ${seed}`, random, next: () => Math.floor(random() * 2 * PAGE_OPERATIONS) };
}

/** The numbers of a page's operations, one after the other, and of the first one of the next page; and so on. */
function each() {
  let nth = 0;
  return { name: 'each operation', random: numbers(SEED), next: () => nth++ % (PAGE_OPERATIONS + 1) };
}

const all = process.env.MOBGATE_CUTS === 'all' ? [each()] : [];
for (const { name: which, random, next } of [...Array.from({ length: SWAPS }, (_, nth) => some(SEED + nth)), ...all]) {
  test(`power cuts of a swap and of the way back leave a whole image, ${which}`, () => {
    const prepared = prepare();
    const { bench, flash, old, other } = prepared;
    stage(flash, other);
    const cuts = startWithCuts(prepared, next, random);
    // If the power fails in the last operation, the swap may be over, and that is the end of the trial.
    const name = program(flash).equals(other) ? OTHER_NAME : NAME;
    runs(bench, name);
    const back = name === NAME ? 0 : startWithCuts(prepared, next, random);
    runs(bench, NAME);
    assert.ok(program(flash).equals(old));
    assert.ok(cuts + back > 40, `${cuts} and ${back} power cuts`);
    assert.deepEqual(bench.faults, []);
  });
}

test('power cuts in the last operations of a swap and of the way back leave a whole image', () => {
  const prepared = prepare();
  const { bench, flash, old, other } = prepared;
  const random = numbers(SEED);
  /** What the flash holds before, and how many operations of it a start without cuts takes. */
  const counted = () => {
    const [before, { operations }] = [Uint8Array.from(flash.bytes), flash];
    startWithCuts(prepared, () => Infinity, random);
    return { before, count: flash.operations - operations };
  };
  stage(flash, other);
  const [swap, back] = [counted(), counted()];
  for (const last of [1, 2, 3]) {
    flash.bytes.set(swap.before);
    startWithCuts(prepared, once(swap.count - last), random);
    const image = program(flash);
    // Without its last operation the swap may be over, as the end of the trial.
    assert.ok(image.equals(other) || last === 1 && image.equals(old), `the last operations of the swap: ${last}`);
  }
  for (const last of [1, 2, 3, 4, 5]) {
    flash.bytes.set(back.before);
    startWithCuts(prepared, once(back.count - last), random);
    runs(bench, NAME);
    assert.ok(program(flash).equals(old), `the last operations of the way back: ${last}`);
  }
  assert.deepEqual(bench.faults, []);
});

/** `nth`, and then never again. */
function once(nth) {
  const values = [nth];
  return () => values.pop() ?? Infinity;
}
