// The cable's other end: frames of the kernel, whose TCP is the client's.
import { readSync, writeSync } from 'node:fs';

/** Opened by `run`. */
const FD = 3;

export class Tap {
  constructor() {
    this.buffer = Buffer.alloc(1600);
  }

  out(frame) {
    writeSync(FD, frame);
  }

  /** Hands waiting frames to `receive`. */
  poll(receive) {
    for (;;) {
      let length;
      try {
        length = readSync(FD, this.buffer);
      } catch (error) {
        if (error.code === 'EAGAIN') return;
        throw error;
      }
      receive(Buffer.from(this.buffer.subarray(0, length)));
    }
  }
}
