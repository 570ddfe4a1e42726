// Settings as lines, those of the candidate or those in force, and the versions that were saved.

import { attempt, get, post, text } from "./api.js";
import { change } from "./commit.js";
import { button, h, table } from "./dom.js";
import { app, may, redraw, tell } from "./state.js";
import { T } from "./texts.js";

let shown = null;
let of = null;
let versions = [];

async function loadSettings() {
  const candidate = app.status.candidate === "open";
  const lines = await text(candidate ? "settings/candidate" : "settings").catch(() => text("settings"));
  const area = document.getElementById("lines");
  // What somebody types is not replaced.
  if (area && area.value === shown) area.value = lines;
  [shown, of] = [lines, candidate ? "candidate" : "force"];
  if (may("engineer")) versions = (await get("settings/versions")).versions;
  redraw();
}

async function put(event) {
  event.preventDefault();
  const typed = event.target.lines.value;
  // It is no longer typed only: the gateway's lines may replace it.
  if (await change(typed.trimEnd().split("\n"), true)) shown = typed;
}

async function bringBack(version) {
  if (!await attempt(() => post("settings/versions", { version }), T.settings.brought)) return;
  app.status.candidate = "open";
  document.getElementById("lines").value = shown;
  await attempt(loadSettings);
}

export const settings = {
  id: "settings",
  load: loadSettings,
  every: 3000,
  draw: () => [
    h("h1", null, T.nav.settings), h("p", { class: "quiet" }, T.settings.intro),
    shown !== null && h("form", { onsubmit: put },
      h("label", { class: "field" }, h("span", null, of === "candidate" ? T.settings.ofCandidate : T.settings.inForce),
        h("textarea", { id: "lines", name: "lines", rows: 18, spellcheck: "false", readonly: !may("engineer"), wrap: "off", value: shown })),
      may("engineer") && h("p", { class: "actions" }, button(T.settings.put, null, { type: "submit", class: "main" }),
        button(T.settings.reset, () => { document.getElementById("lines").value = shown; tell(T.settings.wasReset); }))),
    may("engineer") && [h("h2", null, T.settings.versions), table(T.settings.versions, ["#", T.log.time, T.settings.lines, T.log.who, T.rules.change],
      versions.map((one) => ({ cells: [one.version, one.time, one.lines, one.who, button(T.settings.back, () => bringBack(one.version), { "aria-label": `${T.settings.back}: ${one.version}` })] })), T.settings.noVersions)],
  ],
};
