// The RP2040 image as users flash it, in rp2040js with a W5500, four RS-485 lines and a cable: see README.md.
import assert from 'node:assert/strict';
import test from 'node:test';
import { Bench } from './src/bench.js';
import './updates.js';

const TRANSACTIONS = Number(process.env.MOBGATE_TRANSACTIONS ?? 10_000);
/** RP2040 data sheet 4.7.6, REASON. */
const FORCE = 2;

test('TCP to RTU on four lines: no transaction wrong, and each frame driven without a gap', async () => {
  const bench = new Bench({ baud: 115200 });
  bench.boot();
  bench.gateway('115200');
  const { done, wrong } = await bench.client(TRANSACTIONS);
  console.log(`figure rp2040_transactions ${done} transactions - ok`);
  console.log(`figure rp2040_wrong ${wrong.length} transactions <=0 ${wrong.length ? 'short' : 'ok'}`);
  const { faults } = bench;
  console.log(`figure rp2040_line_faults ${faults.length} - <=0 ${faults.length ? 'short' : 'ok'}`);
  assert.equal(done, TRANSACTIONS);
  assert.deepEqual(wrong.slice(0, 5), []);
  assert.deepEqual(faults.slice(0, 5), []);
  for (const [nth, device] of bench.devices.entries()) {
    assert.deepEqual(device.bad, [], `frames of uart${nth + 1}`);
    assert.equal(device.requests, TRANSACTIONS / 4, `requests on uart${nth + 1}`);
    // Two bits; the device's response comes after 3.5 characters.
    assert.ok(bench.lines[nth].longestHold < 2.1 * bench.lines[nth].bit, `driver of uart${nth + 1}`);
  }
  assert.deepEqual(bench.board.restarts, []);
});

test('saved settings are there after a reboot, and until the button is held', () => {
  const bench = new Bench();
  assert.match(bench.boot(), /mobgate [0-9.]+ on W5500-EVB-Pico/);
  assert.match(bench.console.command('show log'), /started by power/);
  bench.gateway();
  assert.match(bench.console.command('save'), /\n/);
  const { erases } = bench.board.flash;
  bench.console.type('reboot\r');
  assert.ok(bench.board.run(5, () => bench.board.restarts.length === 1), 'reboots');
  assert.equal(bench.board.restarts[0].reason, FORCE);
  bench.boot();
  assert.match(bench.console.command('show config'), /route P502 4 +\* +\* P4/);
  assert.match(bench.console.command('show log'), /started by reboot/);
  assert.match(bench.console.command('read 3 holding 5 count 2 via P3'), /3005 3006/);
  assert.equal(bench.board.flash.erases, erases, 'a start erases nothing');

  bench.board.button = true;
  bench.console.type('reboot\r');
  assert.ok(bench.board.run(5, () => bench.board.restarts.length === 2), 'reboots again');
  bench.board.run(5.5);
  bench.board.release();
  bench.boot();
  assert.doesNotMatch(bench.console.command('show config'), /route/);
  assert.match(bench.console.command('show log'), /forgotten/);
  assert.deepEqual(bench.faults, []);
});

test('each character format goes out and comes in', () => {
  for (const [words, format] of [
    ['9600 8N1', { baud: 9600, parity: 'none' }],
    ['19200 8O1', { parity: 'odd' }],
    ['38400 8N2', { baud: 38400, parity: 'none', stopBits: 2 }],
    ['57600 8E1', { baud: 57600 }],
  ]) {
    const bench = new Bench(format);
    bench.boot();
    bench.gateway(words);
    for (const unit of [1, 2, 3, 4]) {
      const printed = bench.console.command(`read ${unit} holding 7 count 2 via P${unit}`, 10);
      assert.match(printed, new RegExp(`${unit}007 ${unit}008`), words);
    }
    assert.deepEqual(bench.faults, [], words);
  }
});

test('characters with a wrong parity or without a stop bit are counted', () => {
  const bench = new Bench();
  bench.boot();
  bench.gateway();
  const flip = (bit) => (bits, nth) => (nth === 3 ? bits.map((level, n) => (n === bit ? 1 - level : level)) : bits);
  // Behind the start bit and eight data bits.
  bench.lines[0].spoil = flip(9);
  bench.console.command('read 1 holding 7 via P1', 10);
  assert.match(bench.console.command('show stats'), /P1 +parity +1 /);
  bench.lines[0].spoil = flip(10);
  assert.doesNotMatch(bench.console.command('read 1 holding 7 via P1', 10), /1007/);
  assert.match(bench.console.command('show stats'), /P1 +framing +[1-9]/);
  bench.lines[0].spoil = undefined;
  assert.match(bench.console.command('read 1 holding 7 via P1', 10), /1007/);
  assert.deepEqual(bench.faults, []);
});

test('without a W5500 the console works, and with one the network begins', async () => {
  const bench = new Bench({ baud: 115200 }, { chip: false });
  bench.boot();
  bench.gateway('115200');
  assert.match(bench.console.command('show network'), /down/);
  assert.match(bench.console.command('read 2 holding 1 via P2', 10), /2001/);
  bench.w5500.power(true);
  assert.deepEqual(await bench.client(8), { done: 8, wrong: [] });
  // The power of the chip fails for a moment.
  bench.w5500.power(false);
  bench.board.run(2);
  assert.match(bench.console.command('show network'), /down/);
  bench.w5500.power(true);
  bench.board.run(2);
  assert.deepEqual(await bench.client(8), { done: 8, wrong: [] });
  assert.deepEqual(bench.board.restarts, []);
  assert.deepEqual(bench.faults, []);
});

test('a cable that is pulled is noticed, and so is its return', async () => {
  const bench = new Bench({ baud: 115200 });
  bench.boot();
  bench.gateway('115200');
  assert.deepEqual(await bench.client(8), { done: 8, wrong: [] });
  bench.w5500.cable = false;
  bench.board.run(1.1);
  assert.match(bench.console.command('show network'), /down/);
  bench.w5500.cable = true;
  bench.board.run(1.1);
  assert.match(bench.console.command('show network'), /up/);
  assert.deepEqual(await bench.client(8), { done: 8, wrong: [] });
  assert.deepEqual(bench.faults, []);
});

test('a program that stands still is started again by the watchdog, and a fault is told', () => {
  const bench = new Bench();
  bench.boot();
  const { board } = bench;
  board.held = true;
  assert.ok(board.run(9, () => board.restarts.length === 1), 'the watchdog bites');
  bench.boot();
  assert.match(bench.console.command('show log'), /started by the watchdog/);
  board.fault(0x10001234);
  assert.ok(board.run(1, () => board.restarts.length === 2), 'restarts after a fault');
  bench.boot();
  assert.match(bench.console.command('show log'), /the last run ended: fault at 0x10001234/);
});
