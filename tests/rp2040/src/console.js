// The console as a host's terminal at the USB port: what was printed, and what is typed.
import { USBCDC } from 'rp2040js';

/** Buffer controls in the USB's memory (RP2040 data sheet 4.1.2.5): OUT of endpoint 0; AVAILABLE. */
const OUT_CONTROL = 0x84, AVAILABLE = 1 << 10;
const PACKET_NANOS = 50e3;

export class Console {
  constructor() {
    this.text = '';
  }

  attach(chip, board) {
    Object.assign(this, { chip, board, connected: false, room: 0, typed: [], text: '' });
    this.usb = new USBCDC(chip.usbCtrl);
    // rp2040js tells the device at once that a packet is gone; with a delay the next one, or a restart, would overtake it.
    chip.usbCtrl.writeDelayMicroseconds = 0;
    this.usb.onDeviceConnected = () => { this.connected = true; };
    this.usb.onSerialData = (bytes) => { this.text += Buffer.from(bytes).toString('latin1'); };
    chip.usbCtrl.onEndpointRead = (endpoint, size) => {
      if (endpoint !== this.usb.outEndpoint) return;
      // rp2040js takes the buffer from the device as soon as it offers it. The chip does so when a packet has filled it.
      this.control((value) => value | AVAILABLE);
      this.room = size;
      this.deliver();
    };
  }

  /** What was printed, without the escape sequences of the line editor. */
  get shown() {
    // eslint-disable-next-line no-control-regex
    return this.text.replace(/\x1b\[\d*[A-Z]/g, '');
  }

  control(change) {
    const at = OUT_CONTROL + 8 * this.usb.outEndpoint;
    const { usbDPRAMView } = this.chip;
    usbDPRAMView.setUint32(at, change(usbDPRAMView.getUint32(at, true)), true);
  }

  deliver() {
    if (!this.room || !this.typed.length) return;
    const bytes = Uint8Array.from(this.typed.splice(0, this.room));
    this.room = 0;
    this.board.after(PACKET_NANOS, () => {
      this.control((value) => value & ~AVAILABLE);
      this.chip.usbCtrl.finishRead(this.usb.outEndpoint, bytes);
    });
  }

  type(text) {
    this.typed.push(...Buffer.from(text, 'latin1'));
    this.deliver();
  }

  /** Types a command, and returns what is printed until the next prompt. */
  command(line, seconds = 5) {
    this.text = '';
    this.type(`${line}\r`);
    if (!this.board.run(seconds, () => /\n\rmobgate\*?> \r$/.test(this.shown))) {
      throw new Error(`no prompt after ${line}: ${JSON.stringify(this.text)}`);
    }
    return this.shown;
  }
}
