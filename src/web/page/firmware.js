// Update: what runs, how something newer comes, and how it is taken back.

import { attempt, call, get, upload } from "./api.js";
import { button, field, h, input, table } from "./dom.js";
import { may, redraw, tell } from "./state.js";
import { T } from "./texts.js";

let runs = null;
/// How much of a file has gone, from 0 to 1, while one is sent.
let sent = null;

async function loadFirmware() {
  runs = await get("update");
  redraw();
}

async function send(event) {
  event.preventDefault();
  const file = event.target.elements.image.files[0];
  sent = 0;
  redraw();
  await attempt(async () => {
    const { version } = await upload("update", file, (share) => {
      sent = share;
      redraw();
    });
    tell(T.update.taken(version));
  });
  sent = null;
  redraw();
}

const goBack = () => attempt(() => call("DELETE", "update"), T.update.goesBack);

function ofBoard() {
  return [
    h("p", null, T.update.ofBoard),
    may("engineer") && h("section", { class: "card" }, h("h2", null, T.update.send),
      h("form", { class: "row", onsubmit: send },
        field(T.update.image, input({ type: "file", name: "image", accept: ".mgu", required: true }), T.update.imageHint),
        button(T.update.submit, null, { type: "submit", class: "main", disabled: sent !== null })),
      sent !== null && h("p", { role: "status" }, h("progress", { "aria-label": T.update.progress, max: 1, value: sent }),
        sent < 1 ? ` ${Math.round(100 * sent)} %` : ` ${T.update.checked}`)),
    may("engineer") && runs.state === "on trial" && h("p", { class: "actions" }, button(T.update.back, goBack)),
  ];
}

export const firmware = {
  id: "update",
  load: loadFirmware,
  every: 5000,
  draw: () => [
    h("h1", null, T.nav.update),
    runs && table(T.update.running, [T.update.version, T.update.board, T.update.state], [{ cells: [runs.version, runs.board, runs.state || "–"] }]),
    runs && (runs.state
      ? ofBoard()
      : h("section", { class: "card" }, h("p", null, T.update.packaged), h("pre", { tabindex: 0 }, T.update.command), h("p", { class: "quiet" }, T.update.after))),
  ],
};
