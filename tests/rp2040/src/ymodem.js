// A terminal that sends a file by YMODEM, as `sb` does (Forsberg, "XMODEM/YMODEM Protocol Reference", 1988).

const SOH = 0x01, STX = 0x02, EOT = 0x04, ACK = 0x06, NAK = 0x15, CAN = 0x18, ASK = 0x43;
/** What fills up the last block. */
const PADDING = 0x1a;
/** Longest time until the console is back: the file, the swap and a start, in seconds. */
const BACK = 240;

function block(number, kind, data) {
  let crc = 0;
  for (const byte of data) {
    crc ^= byte << 8;
    for (let bit = 0; bit < 8; bit++) crc = (crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1) & 0xffff;
  }
  return Buffer.concat([Buffer.from([kind, number & 0xff, ~number & 0xff]), data, Buffer.from([crc >> 8, crc & 0xff])]);
}

/** What is sent, each after these bytes have come. */
function* steps(file) {
  const header = Buffer.alloc(128);
  header.write(`firmware.mgu\0${file.length}`, 'latin1');
  yield [[ASK], block(0, SOH, header)];
  for (let at = 0; at < file.length; at += 1024) {
    const data = Buffer.alloc(1024, PADDING);
    file.copy(data, 0, at);
    yield [at ? [ACK] : [ACK, ASK], block(at / 1024 + 1, STX, data)];
  }
  yield [[ACK], Buffer.from([EOT])];
  yield [[ACK, ASK], block(0, SOH, Buffer.alloc(128))];
}

/** Types `command`, sends `file` when it is asked for, and returns what the terminal shows until the next prompt, be it of another run. */
export function send(bench, command, file) {
  const { board, console: terminal } = bench;
  const sent = steps(file);
  let step = sent.next().value;
  let [last, heard, at, shown, run] = [undefined, 0, undefined, '', board.chip];
  const hear = (byte) => {
    if (byte === CAN) step = undefined;
    else if (byte === NAK && last) terminal.type(last);
    else if (step && byte === step[0][heard]) heard++;
    if (!step || heard < step[0].length) return;
    [heard, last] = [0, step[1].toString('latin1')];
    terminal.type(last);
    step = sent.next().value;
  };
  terminal.text = '';
  terminal.type(`${command}\r`);
  const back = board.run(BACK, () => {
    // Another run has a terminal of its own.
    if (board.chip !== run) [run, step, at] = [board.chip, undefined, 0];
    if (at === undefined && terminal.text.includes('\r\n')) at = terminal.text.indexOf('\r\n') + 2;
    if (at === undefined) return false;
    for (; at < terminal.text.length; at++) {
      shown += terminal.text[at];
      hear(terminal.text.charCodeAt(at));
    }
    return /mobgate\*?> \r$/.test(terminal.shown) && terminal.connected;
  });
  if (!back) throw new Error(`no prompt after ${command}: ${JSON.stringify(shown.slice(-500))}`);
  // eslint-disable-next-line no-control-regex
  return shown.replace(/\x1b\[\d*[A-Z]/g, '');
}
