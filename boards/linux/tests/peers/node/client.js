// A Modbus client by modbus-serial: client.js WHERE UNIT BASE
//
// WHERE is tcp:PORT for Modbus TCP on the loopback address, rtu:PORT for RTU over TCP, or a serial device for RTU at 115200 8N1.
//
// Uses the public functions for bits and registers on UNIT, whose input registers begin with the value BASE, and compares all
// values.
"use strict";
const assert = require("node:assert/strict");
const ModbusRTU = require("../../../../../target/node/node_modules/modbus-serial");

const EXCEPTION_ADDRESS = 2;
const PATIENCE_MS = 20000;

async function connect(client, where) {
    const [framing, port] = where.split(":");
    if (framing === "tcp") return client.connectTCP("127.0.0.1", { port: Number(port) });
    // Its other way by TCP that has RTU in its name sends the header of Modbus TCP.
    if (framing === "rtu") return client.connectTelnet("127.0.0.1", { port: Number(port) });
    return client.connectRTUBuffered(where, { baudRate: 115200, dataBits: 8, parity: "none", stopBits: 1 });
}

async function bits(client) {
    const inputs = (await client.readDiscreteInputs(1, 20)).data.slice(0, 20);
    assert.deepEqual(inputs, [...Array(20).keys()].map((bit) => (bit + 1) % 3 === 0));
    await client.writeCoil(3, true);
    await client.writeCoils(10, [true, false, true, true, false, true, true, true, true]);
    const coils = (await client.readCoils(0, 20)).data;
    assert.deepEqual([...Array(20).keys()].filter((bit) => coils[bit]), [3, 10, 12, 13, 15, 16, 17, 18]);
    await client.writeCoil(3, false);
    assert.equal((await client.readCoils(3, 1)).data[0], false);
}

async function registers(client, base) {
    const inputs = (await client.readInputRegisters(7, 5)).data;
    assert.deepEqual(inputs, [7, 8, 9, 10, 11].map((address) => base + address));
    await client.writeRegister(1, 0xffff);
    await client.writeRegisters(2, [0x1234, 0, 42]);
    assert.deepEqual((await client.readHoldingRegisters(0, 6)).data, [0, 0xffff, 0x1234, 0, 42, 0]);
    // Many, so that the response comes in pieces.
    const many = [...Array(90).keys()].map((value) => 1000 + value);
    await client.writeRegisters(6, many);
    assert.deepEqual((await client.readHoldingRegisters(6, 90)).data, many);
}

async function exceptions(client) {
    const refused = (asked) => assert.rejects(asked, (error) => error.modbusCode === EXCEPTION_ADDRESS);
    await refused(client.readHoldingRegisters(60000, 2));
    await refused(client.readInputRegisters(60000, 1));
}

async function main() {
    const [where, unit, base] = process.argv.slice(2);
    const client = new ModbusRTU();
    await connect(client, where);
    client.setID(Number(unit));
    client.setTimeout(PATIENCE_MS);
    await bits(client);
    await registers(client, Number(base));
    await exceptions(client);
    console.log("all compared");
    process.exit(0);
}

main().catch((error) => {
    console.error(error);
    process.exit(1);
});
