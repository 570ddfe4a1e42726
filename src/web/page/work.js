// `scan` and `tune`: what they say while they run, and the lines that they propose.

import { attempt, lines, post } from "./api.js";
import { button, h } from "./dom.js";
import { redraw, tell } from "./state.js";
import { T } from "./texts.js";

/// The work that runs, or ran last: its kind, port, lines so far, and what it found.
export const work = { kind: null, port: null, running: false, begun: 0, ends: 0, log: [], found: [], proposed: [] };

/// When a scan is over by its own estimate, if this line has one: `about 12s; ...`, `... in all 3m left`.
function estimate(line) {
  const [, count, unit] = /(?:^about|in all) (\d+)([sm])\b/.exec(line) || [];
  if (count) work.ends = performance.now() + count * (unit === "m" ? 60_000 : 1000);
}

/// How much of the work is done, from 0 to 1; less than 1 until it is over.
const done = () => Math.min((performance.now() - work.begun) / (work.ends - work.begun), 0.99);

/// Runs it to its end; the promise has whether it came there.
export async function runWork(kind, request) {
  Object.assign(work, { kind, port: request.port, running: true, begun: performance.now(), ends: 0, log: [], found: [], proposed: [] });
  redraw();
  const well = await attempt(() => lines(kind, request, (line) => {
    const unit = /^unit +(\d+) (\S+ \S+) +(\S+) (.*)$/.exec(line);
    if (kind === "scan" && unit) work.found.push({ unit: Number(unit[1]), speed: unit[2], took: unit[3], about: unit[4] });
    else if (/^(edit|route) /.test(line)) work.proposed.push(line.replace(/ *#.*/, ""));
    estimate(line);
    work.log.push(line);
    redraw();
  }));
  work.running = false;
  redraw();
  return well;
}

/// Units next to each other as ranges: `1-3`, `7`.
export function ranges(units) {
  const sorted = [...new Set(units)].sort((one, other) => one - other);
  const spans = [];
  for (const unit of sorted) {
    const last = spans.at(-1);
    if (last && unit === last[1] + 1) last[1] = unit;
    else spans.push([unit, unit]);
  }
  return spans.map(([first, last]) => (first === last ? `${first}` : `${first}-${last}`));
}

/// The last line, which tells why nothing is proposed, all of them, and a way to stop.
export function workPanel() {
  if (!work.kind) return null;
  const last = work.log.at(-1) || "";
  return h("div", { class: "work", role: "status" },
    (work.running || !work.proposed.length) && h("p", null, work.running && h("progress", { "aria-label": T.work[work.kind], value: work.ends ? done() : null }), " ", last),
    h("details", null, h("summary", null, T.work.log), h("pre", { tabindex: 0 }, work.log.join("\n"))),
    work.running && h("p", { class: "actions" }, button(T.work.stop, () => attempt(() => post("stop")).then(() => tell(T.work.stopping)))));
}
