// Update: what runs, and how something newer comes.

import { get } from "./api.js";
import { h, table } from "./dom.js";
import { redraw } from "./state.js";
import { T } from "./texts.js";

let runs = null;

async function loadFirmware() {
  runs = await get("update");
  redraw();
}

export const firmware = {
  id: "update",
  load: loadFirmware,
  every: 5000,
  draw: () => [
    h("h1", null, T.nav.update),
    runs && table(T.update.running, [T.update.version, T.update.board, T.update.state], [{ cells: [runs.version, runs.board, runs.state || "–"] }]),
    runs && (runs.state
      ? h("p", null, T.update.ofBoard)
      : h("section", { class: "card" }, h("p", null, T.update.packaged), h("pre", { tabindex: 0 }, T.update.command), h("p", { class: "quiet" }, T.update.after))),
  ],
};
