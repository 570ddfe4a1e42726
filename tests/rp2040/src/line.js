// An RS-485 line at the chip's pins, bit by bit in simulated time: what the chip sends is sampled in the middle of each bit, and what
// a device responds is put on the pin. It measures what a bus cares about: driver, gaps, silences.

/** Modbus over Serial Line 2.5.1.1: silences above 19200 baud. */
const T15_NANOS = 750e3, T35_NANOS = 1750e3;

export class Line {
  /** `device.response(frame)` is what is behind the line. */
  constructor(pins, { baud = 19200, dataBits = 8, parity = 'even', stopBits = 1 }, device) {
    Object.assign(this, { pins, dataBits, parity, stopBits, device });
    this.bit = 1e9 / baud;
    this.bits = dataBits + (parity === 'none' ? 0 : 1);
    this.character = (1 + this.bits + stopBits) * this.bit;
    this.t15 = baud > 19200 ? T15_NANOS : 1.5 * this.character;
    this.t35 = baud > 19200 ? T35_NANOS : 3.5 * this.character;
    /** What must be empty at the end. */
    this.faults = [];
    this.frames = 0;
    this.characters = 0;
    this.longestHold = 0;
    /** Changes responses, for tests of mishaps: gets the bits of a character. */
    this.spoil = undefined;
  }

  attach(chip, board) {
    const [transmit, receive, driver] = [this.pins.transmit, this.pins.receive, this.pins.driver].map((n) => chip.gpio[n]);
    Object.assign(this, { board, receive });
    this.receiving = false;
    this.frame = [];
    this.lastEnd = -Infinity;
    this.answering = false;
    receive.setInputValue(true);
    const high = (pin) => pin.outputEnable && pin.outputValue;
    this.driven = () => high(driver);
    this.level = () => high(transmit);
    transmit.addListener(() => { if (!this.level() && !this.receiving && this.driven()) this.begin(); });
    driver.addListener(() => {
      const { nanos } = board.clock;
      if (this.driven()) {
        if (this.answering) this.faults.push('the driver goes on while a device responds');
      } else if (this.receiving) {
        this.faults.push('the driver goes off within a character');
      } else if (this.lastEnd > 0) {
        this.longestHold = Math.max(this.longestHold, nanos - this.lastEnd);
      }
    });
  }

  /** A start bit. */
  begin() {
    const { clock } = this.board;
    const gap = clock.nanos - this.lastEnd;
    if (this.frame.length && gap > this.t15) this.faults.push(`a gap of ${Math.round(gap / 1000)} us within a frame`);
    if (!this.frame.length && gap < this.t35) this.faults.push(`a silence of ${Math.round(gap / 1000)} us before a frame`);
    this.receiving = true;
    const bits = [];
    const start = clock.nanos;
    const sample = () => {
      if (!this.driven()) this.faults.push('the driver is off in a character');
      bits.push(this.level() ? 1 : 0);
      if (bits.length < 1 + this.bits + this.stopBits) this.board.after(this.bit, sample);
      else this.board.after(start + this.character - clock.nanos - this.bit / 16, () => this.end(bits));
    };
    this.board.after(this.bit / 2, sample);
  }

  /** Just before the last stop bit's end. */
  end(bits) {
    if (!this.driven()) this.faults.push('the driver is off before the last stop bit has ended');
    this.receiving = false;
    this.lastEnd = this.board.clock.nanos + this.bit / 16;
    this.characters++;
    const data = bits.slice(1, 1 + this.dataBits);
    const ones = data.reduce((sum, bit) => sum + bit, 0);
    const stops = bits.slice(1 + this.bits);
    if (bits[0] || stops.includes(0)) this.faults.push(`frame of bits ${bits.join('')}`);
    if (this.parity !== 'none' && bits[1 + this.dataBits] !== ((ones & 1) ^ (this.parity === 'odd' ? 1 : 0))) {
      this.faults.push(`parity of bits ${bits.join('')}`);
    }
    this.frame.push(data.reduce((byte, bit, n) => byte | bit << n, 0));
    this.silence?.cancel();
    this.silence = this.board.after(this.t35, () => this.complete());
  }

  complete() {
    this.frames++;
    const frame = Buffer.from(this.frame);
    this.frame = [];
    const response = this.device?.response(frame);
    if (response) this.send(response);
  }

  /** Puts a frame of a device on the line. */
  send(bytes, then = () => {}) {
    if (this.driven()) this.faults.push('the driver is on when a device responds');
    this.answering = true;
    const levels = [...bytes].flatMap((byte, nth) => {
      const data = Array.from({ length: this.dataBits }, (_, bit) => byte >> bit & 1);
      const odd = data.reduce((sum, bit) => sum ^ bit, 0);
      const check = this.parity === 'none' ? [] : [this.parity === 'odd' ? 1 - odd : odd];
      const bits = [0, ...data, ...check, ...Array(this.stopBits).fill(1)];
      return this.spoil?.(bits, nth) ?? bits;
    });
    const start = this.board.clock.nanos;
    let last = 1;
    let nth = 0;
    const step = () => {
      while (nth < levels.length && levels[nth] === last) nth++;
      if (nth === levels.length) {
        this.board.after(Math.max(0, start + levels.length * this.bit - this.board.clock.nanos), () => {
          this.answering = false;
          this.lastEnd = this.board.clock.nanos;
          this.receive.setInputValue(true);
          then();
        });
        return;
      }
      this.board.after(Math.max(0, start + nth * this.bit - this.board.clock.nanos), () => {
        last = levels[nth];
        this.receive.setInputValue(!!last);
        step();
      });
    };
    step();
  }
}
