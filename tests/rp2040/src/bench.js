// The whole bench: board, console, W5500, four lines with a device each, the cable to the kernel, and time.
import { spawn } from 'node:child_process';
import { readFileSync } from 'node:fs';
import { Board } from './board.js';
import { Console } from './console.js';
import { Device } from './rtu.js';
import { Line } from './line.js';
import { Tap } from './tap.js';
import { W5500 } from './w5500.js';

const IMAGE = new URL('../../../target/thumb/thumbv6m-none-eabi/release/mobgate-w5500-evb-pico.uf2', import.meta.url);
/** GPIOs of `uart1` to `uart4`: boards/README.md. */
export const PINS = [[0, 1, 2], [4, 5, 3], [6, 7, 8], [9, 10, 11]].map(
  ([transmit, receive, driver]) => ({ transmit, receive, driver }));
/** Simulated time between two looks at the cable. */
const STEP_SECONDS = 0.0003;

export class Bench {
  /** With a device of units 1 to 4 behind lines of this format. */
  constructor(format = {}, { chip = true } = {}) {
    this.tap = new Tap();
    // What is left of another test.
    this.tap.poll(() => {});
    this.board = new Board(readFileSync(IMAGE));
    this.console = this.board.attach(new Console());
    this.w5500 = new W5500(this.tap);
    this.w5500.present = chip;
    this.board.attach(this.w5500);
    this.devices = PINS.map((_, n) => new Device(n + 1));
    this.lines = PINS.map((pins, n) => this.board.attach(new Line(pins, format, this.devices[n])));
  }

  /** Runs until the console responds, for `seconds` at most. */
  boot(seconds = 10) {
    const begin = this.board.seconds;
    if (!this.board.run(seconds, () => this.console.connected && /mobgate> \r/.test(this.console.shown) && this.board.seconds > begin + 0.1)) {
      throw new Error(`no console: ${JSON.stringify(this.console.text)}`);
    }
    return this.console.command('show version');
  }

  set(...lines) {
    return lines.map((line) => {
      const printed = this.console.command(line);
      if (/error/.test(printed)) throw new Error(printed);
      return printed;
    });
  }

  /** A gateway from TCP to the four lines. */
  gateway(format = '') {
    this.set('network address 192.168.7.2/24', 'port P502 tcp server 502',
      ...PINS.flatMap((_, n) => [`port P${n + 1} serial uart${n + 1} rtu client ${format}`, `route P502 ${n + 1} * * P${n + 1}`]));
  }

  /** Runs with the cable, until `work` is done. The board's time never overtakes the kernel's, so that neither retransmits early. */
  async play(work) {
    let over = false;
    let result, problem;
    work.then((value) => { result = value; }, (error) => { problem = error; }).finally(() => { over = true; });
    const [from, began] = [this.board.seconds, performance.now()];
    while (!over) {
      this.board.run(STEP_SECONDS);
      this.tap.poll((frame) => this.w5500.receive(frame));
      const ahead = (this.board.seconds - from) * 1000 - (performance.now() - began);
      // eslint-disable-next-line no-await-in-loop
      await new Promise((next) => { if (ahead > 1) setTimeout(next, ahead); else setImmediate(next); });
    }
    if (problem) throw problem;
    return result;
  }

  /** `count` transactions by the client. */
  client(count, units = [1, 2, 3, 4]) {
    const child = spawn(process.execPath, [new URL('client.js', import.meta.url).pathname, count, ...units],
      { stdio: ['ignore', 'pipe', 'inherit'] });
    let printed = '';
    child.stdout.on('data', (text) => { printed += text; });
    return this.play(new Promise((done, fail) => {
      child.on('close', (code) => (code ? fail(new Error(`the client ended with ${code}`)) : done(JSON.parse(printed))));
    }));
  }

  /** What no test may leave behind. */
  get faults() {
    const { board, w5500, lines } = this;
    const beyond = board.flash.bytes.subarray(2 * 1024 * 1024).some((byte) => byte !== 0xff);
    return [...w5500.faults, ...board.flash.faults, ...lines.flatMap((line) => line.faults), ...(beyond ? ['beyond the flash'] : [])];
  }
}
