// The last transactions, and the audit trail.

import { get } from "./api.js";
import { h, table } from "./dom.js";
import { may, redraw } from "./state.js";
import { T } from "./texts.js";

let transactions = [];
let trail = [];

async function loadLog() {
  transactions = (await get("log")).log;
  if (may("engineer")) trail = (await get("audit")).audit;
  redraw();
}

export const log = {
  id: "log",
  load: loadLog,
  every: 2000,
  draw: () => [
    h("h1", null, T.nav.log),
    may("engineer") && [h("h2", null, T.log.audit), table(T.log.audit, [T.log.time, T.log.who, T.log.what],
      [...trail].reverse().map((line) => ({ cells: [line.time.replace("T", " ").replace("Z", ""), line.who, line.what] })), T.log.noAudit)],
    h("h2", null, T.log.transactions), table(T.log.transactions,
      [{ text: T.points.age, right: true }, T.rules.source, T.unit, T.rules.destination, T.log.target, T.rules.function, { text: T.devices.took, right: true }, T.log.outcome],
      [...transactions].reverse().map((one) => ({ cells: [one.age, one.source, one.unit, one.destination, one.target, one.function, one.took, one.outcome] })), T.log.none),
  ],
};
