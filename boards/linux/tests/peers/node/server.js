// A Modbus TCP server by modbus-serial: server.js PORT UNIT
//
// The unit has 64 coils (off), 64 discrete inputs (every third is on), 100 holding registers (0) and 100 input registers, of
// which register A of unit U holds 256 * U + A. Other addresses get exception 02, other units no response.
"use strict";
const { ServerTCP } = require("../../../../../target/node/node_modules/modbus-serial");

const [port, unit] = process.argv.slice(2).map(Number);
const coils = Array(64).fill(false);
const holding = Array(100).fill(0);

function within(count, address, value) {
    if (address < count) return value;
    throw { modbusErrorCode: 2 };
}

const vector = {
    getCoil: (address) => within(64, address, coils[address]),
    getDiscreteInput: (address) => within(64, address, address % 3 === 0),
    getInputRegister: (address) => within(100, address, 256 * unit + address),
    getHoldingRegister: (address) => within(100, address, holding[address]),
    setCoil: (address, value) => {
        coils[within(64, address, address)] = value;
    },
    setRegister: (address, value) => {
        holding[within(100, address, address)] = value;
    },
};

const server = new ServerTCP(vector, { host: "127.0.0.1", port, unitID: unit });
server.on("initialized", () => console.log("ready"));
server.on("socketError", () => {}); // the gateway has left
