// EtherCAT: the gateway as a device of a MainDevice, its devices, and the process image.

import { get } from "./api.js";
import { h, table } from "./dom.js";
import { app, redraw } from "./state.js";
import { T } from "./texts.js";

let fieldbusState = { ethercat: [], modules: [], image: [] };

async function loadEthercat() {
  fieldbusState = await get("ethercat");
  redraw();
}

/// How the device `number` does: the status has the devices of the image behind those of the scanner.
const stateOf = (number) => app.status.devices.find((device) => device.device === `slave ${number}`)?.state;

export const ethercat = {
  id: "ethercat",
  isOffered: () => app.status.ports.some((port) => port.role === "ethercat"),
  load: loadEthercat,
  every: 2000,
  draw: () => [
    h("h1", null, T.nav.ethercat), h("p", { class: "quiet" }, T.ethercat.intro),
    table(T.nav.ethercat, [T.ethercat.controller, T.ethercat.state, T.ethercat.line],
      fieldbusState.ethercat.map((row) => ({ cells: [row.controller, row.state, row.line] })), T.ethercat.none),
    h("h2", null, T.ethercat.modules),
    table(T.ethercat.modules, [T.ethercat.number, T.unit, T.devices.state, T.ethercat.inputs, T.ethercat.outputs],
      fieldbusState.modules.map((row) => ({ cells: [row.no, row.unit, stateOf(row.no), row.inputs, row.outputs] })), T.ethercat.noModules),
    h("h2", null, T.ethercat.image),
    table(T.ethercat.image, [T.ethercat.number, T.unit, T.ethercat.direction, T.points.device, T.ethercat.image],
      fieldbusState.image.map((row) => ({ cells: [row.no, row.unit, T.ethercat.ways[row.image], `${row.table} ${row.address}`, h("span", { class: "value" }, row.values)] })), T.ethercat.noImage),
  ],
};
