// A Modbus RTU device. The check sum is that of the npm package modbus-serial.
import crc16 from 'modbus-serial/utils/crc16.js';

/** A device with 1000 holding registers, which begin as their addresses and its unit. */
export class Device {
  constructor(unit) {
    this.unit = unit;
    this.registers = Uint16Array.from({ length: 1000 }, (_, address) => unit * 1000 + address);
    this.requests = 0;
    this.bad = [];
  }

  /** The response to a frame of the line, if it is for this device. */
  response(frame) {
    if (frame.length < 4 || crc16(frame.subarray(0, -2)) !== frame.readUInt16LE(frame.length - 2)) {
      this.bad.push(frame.toString('hex'));
      return undefined;
    }
    if (frame[0] !== this.unit) return undefined;
    this.requests++;
    const [code, address, value] = [frame[1], frame.readUInt16BE(2), frame.readUInt16BE(4)];
    let body;
    if (code === 3 && address + value <= 1000) {
      body = Buffer.alloc(3 + 2 * value);
      body[2] = 2 * value;
      for (let n = 0; n < value; n++) body.writeUInt16BE(this.registers[address + n], 3 + 2 * n);
    } else if (code === 6 && address < 1000) {
      this.registers[address] = value;
      body = Buffer.from(frame.subarray(0, 6));
    } else {
      body = Buffer.from([0, code | 0x80, 2]);
      body[1] = code | 0x80;
      body[0] = this.unit;
      return withCheck(body);
    }
    body[0] = this.unit;
    body[1] = code;
    return withCheck(body);
  }
}

function withCheck(body) {
  const check = Buffer.alloc(2);
  check.writeUInt16LE(crc16(body));
  return Buffer.concat([body, check]);
}
