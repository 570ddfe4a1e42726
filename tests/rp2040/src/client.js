// A Modbus TCP client by modbus-serial, a process of its own: client.js COUNT UNIT...
//
// Reads and writes COUNT times in all, on a connection for each unit at a time, and compares each value with what must be there.
// Prints a line of JSON.
import ModbusRTU from 'modbus-serial';

const [count, ...units] = process.argv.slice(2).map(Number);
// Far above what the emulated board takes.
const PATIENCE_MS = 60_000;
const wrong = [];

async function work(unit) {
  const client = new ModbusRTU();
  client.setTimeout(PATIENCE_MS);
  await client.connectTCP('192.168.7.2', { port: 502 });
  client.setID(unit);
  const registers = Array.from({ length: 1000 }, (_, address) => unit * 1000 + address);
  const expect = (what, is, should) => {
    if (JSON.stringify(is) !== JSON.stringify(should)) wrong.push({ unit, what, is, should });
  };
  const mine = Math.floor(count / units.length);
  for (let nth = 0; nth < mine; nth++) {
    const address = (nth * 37) % 990;
    try {
      if (nth % 4 === 3) {
        registers[address] = (nth * 7919 + unit) & 0xffff;
        const { value } = await client.writeRegister(address, registers[address]);
        expect(`write ${address}`, value, registers[address]);
      } else {
        const length = 1 + nth % 5;
        const { data } = await client.readHoldingRegisters(address, length);
        expect(`read ${address}`, data, registers.slice(address, address + length));
      }
    } catch (error) {
      wrong.push({ unit, what: `${address}: ${error.message ?? error}` });
    }
  }
  await new Promise((done) => { client.close(done); });
  return mine;
}

const done = await Promise.all(units.map(work));
console.log(JSON.stringify({ done: done.reduce((a, b) => a + b), wrong }));
