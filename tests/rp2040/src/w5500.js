// A W5500 at the chip's SPI0, by its data sheet (version 1.1.0): common registers, socket 0 in MACRAW mode with its buffers, the
// interrupt and the reset pin. Frames go to and come from `network`.

const [CS, RESET, INTERRUPT] = [17, 20, 21];
const BUFFER = 0x4000;
/** Control byte (2.2.2): block in bits 7-3, write in bit 2. */
const [COMMON, SOCKET, TRANSMIT, RECEIVE] = [0, 1, 2, 3];
/** Socket registers (4.2). */
const [MODE, COMMAND, IR, STATUS, TX_FREE, TX_READ, TX_WRITE, RX_SIZE, RX_READ, RX_WRITE, IMR] =
  [0x00, 0x01, 0x02, 0x03, 0x20, 0x22, 0x24, 0x26, 0x28, 0x2a, 0x2c];
const [OPEN, CLOSE, SEND, RECV] = [0x01, 0x10, 0x20, 0x40];
const [RECEIVED, SENT] = [0x04, 0x10];
const MACRAW = 0x42;
/** Sn_MR: MAC filter, multicast blocking. */
const [FILTER, NO_MULTICAST] = [0x80, 0x20];
/** 100 Mbit/s: nanoseconds for a byte; preamble, check sum and gap. */
const BYTE_NANOS = 80, AROUND_BYTES = 24;

export class W5500 {
  constructor(network) {
    this.network = network;
    this.present = true;
    this.cable = true;
    this.counts = { in: 0, out: 0, dropped: 0, filtered: 0 };
    this.faults = [];
    this.reset();
  }

  reset() {
    this.common = new Uint8Array(0x40);
    this.common[0x39] = 4;
    this.socket = new Uint8Array(0x30);
    this.socket[0x1e] = this.socket[0x1f] = 2;
    this.tx = new Uint8Array(BUFFER);
    this.rx = new Uint8Array(BUFFER);
    this.sending = false;
  }

  attach(chip, board) {
    this.board = board;
    this.chip = chip;
    this.selected = false;
    const [spi] = chip.spi;
    spi.onTransmit = (byte) => {
      const response = this.exchange(byte);
      board.after(8e9 / spi.clockFrequency, () => spi.completeTransmit(response));
    };
    chip.gpio[CS].addListener((state) => {
      this.selected = state === 0;
      this.at = -3;
    });
    chip.gpio[RESET].addListener((state) => { if (state === 0) this.reset(); });
    this.interrupt();
  }

  /** The power of the chip fails, or comes back. */
  power(on) {
    this.present = on;
    this.reset();
    this.interrupt();
  }

  exchange(byte) {
    if (!this.selected || !this.present) return 0;
    const at = this.at++;
    if (at === -3) this.address = byte << 8;
    else if (at === -2) this.address |= byte;
    else if (at === -1) this.control = byte;
    else {
      const [block, write] = [this.control >> 3, this.control & 4];
      const address = (this.address + at) & 0xffff;
      if (write) this.write(block, address, byte);
      else return this.read(block, address);
    }
    return 0;
  }

  word(register) {
    return (this.socket[register] << 8) | this.socket[register + 1];
  }

  setWord(register, value) {
    this.socket[register] = value >> 8 & 0xff;
    this.socket[register + 1] = value & 0xff;
  }

  get room() {
    return this.socket[0x1e] * 1024;
  }

  read(block, address) {
    switch (block) {
      case COMMON:
        // PHYCFGR: not in reset, all modes, 100 Mbit/s, full duplex, link.
        if (address === 0x2e) return 0xbe | (this.cable ? 1 : 0);
        // SIR
        if (address === 0x17) return this.socket[IR] & this.socket[IMR] ? 1 : 0;
        return this.common[address] ?? 0;
      case SOCKET:
        if (address === TX_FREE) {
          const used = (this.word(TX_WRITE) - this.word(TX_READ)) & 0xffff;
          this.setWord(TX_FREE, this.socket[0x1f] * 1024 - used);
        }
        if (address === RX_SIZE) this.setWord(RX_SIZE, (this.word(RX_WRITE) - this.word(RX_READ)) & 0xffff);
        return this.socket[address] ?? 0;
      case TRANSMIT: return this.tx[address % BUFFER];
      case RECEIVE: return this.rx[address % BUFFER];
      default: this.faults.push(`block ${block}`); return 0;
    }
  }

  write(block, address, byte) {
    if (block === COMMON) {
      if (address === 0 && byte & 0x80) this.reset();
      else this.common[address] = byte;
    } else if (block === SOCKET) {
      if (address === COMMAND) this.command(byte);
      else if (address === IR) this.socket[IR] &= ~byte;
      else if (address !== STATUS) this.socket[address] = byte;
    } else if (block === TRANSMIT) {
      this.tx[address % BUFFER] = byte;
    } else {
      this.faults.push(`write to block ${block}`);
    }
    this.interrupt();
  }

  command(command) {
    switch (command) {
      case OPEN:
        if ((this.socket[MODE] & 0xf) !== 4) this.faults.push('not MACRAW');
        this.socket[STATUS] = MACRAW;
        break;
      case CLOSE: this.socket[STATUS] = 0; break;
      case SEND: this.send(); break;
      case RECV:
        // What is left raises the interrupt again.
        if (this.word(RX_WRITE) !== this.word(RX_READ)) this.socket[IR] |= RECEIVED;
        break;
      default: this.faults.push(`command ${command}`);
    }
  }

  send() {
    const [from, to] = [this.word(TX_READ), this.word(TX_WRITE)];
    const length = (to - from) & 0xffff;
    if (this.socket[STATUS] !== MACRAW || this.sending || length > 1514) this.faults.push(`send of ${length}`);
    const frame = Buffer.alloc(length);
    for (let n = 0; n < length; n++) frame[n] = this.tx[(from + n) % BUFFER];
    this.sending = true;
    this.board.after((length + AROUND_BYTES) * BYTE_NANOS, () => {
      this.sending = false;
      this.setWord(TX_READ, to);
      this.socket[IR] |= SENT;
      this.interrupt();
      this.counts.out++;
      if (this.cable) this.network.out(frame);
    });
  }

  /** A frame from the cable. */
  receive(frame) {
    if (!this.cable || !this.present || this.socket[STATUS] !== MACRAW) return;
    const own = this.common.subarray(0x09, 0x0f);
    const mode = this.socket[MODE];
    if (mode & FILTER) {
      const broadcast = frame.subarray(0, 6).every((byte) => byte === 0xff);
      const multicast = frame[0] & 1 && !(mode & NO_MULTICAST);
      if (!broadcast && !multicast && !frame.subarray(0, 6).equals(Buffer.from(own))) {
        this.counts.filtered++;
        return;
      }
    }
    const size = frame.length + 2;
    const write = this.word(RX_WRITE);
    const used = (write - this.word(RX_READ)) & 0xffff;
    if (used + size > this.room) {
      this.counts.dropped++;
      return;
    }
    [size >> 8, size & 0xff, ...frame].forEach((byte, n) => { this.rx[(write + n) % BUFFER] = byte; });
    this.setWord(RX_WRITE, (write + size) & 0xffff);
    this.socket[IR] |= RECEIVED;
    this.counts.in++;
    this.interrupt();
  }

  interrupt() {
    const low = this.present && this.common[0x18] & 1 && this.socket[IR] & this.socket[IMR];
    this.chip?.gpio[INTERRUPT].setInputValue(!low);
  }
}
