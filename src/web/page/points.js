// Points: live values with age and quality, a small plot, and writing with confirmation.

import { attempt, post } from "./api.js";
import { ask, button, field, h, input, lamp, table, v } from "./dom.js";
import { app, may, redraw } from "./state.js";
import { T } from "./texts.js";

const [PLOT_WIDTH, PLOT_HEIGHT] = [120, 26];
const VALUES_SHOWN = 8;

/// The first value over the last two minutes.
function plot(point) {
  const past = (app.history.get(point.name) || []).map(Number);
  if (past.length < 2 || past.some(Number.isNaN)) return "";
  const [low, high] = [Math.min(...past), Math.max(...past)];
  const at = (value, nth) => `${((nth * PLOT_WIDTH) / (past.length - 1)).toFixed(1)},${(PLOT_HEIGHT - 2 - ((value - low) / (high - low || 1)) * (PLOT_HEIGHT - 4)).toFixed(1)}`;
  return v("svg", { class: "plot", viewBox: `0 0 ${PLOT_WIDTH} ${PLOT_HEIGHT}`, role: "img", "aria-label": T.points.plot(point.name, low, high) },
    v("polyline", { points: past.map(at).join(" ") }));
}

/// What to send: numbers together, and what a number of JSON does not hold one by one, as it is typed.
function bodies(point, isText, typed) {
  if (isText) return [{ point: point.name, text: typed }];
  const words = typed.split(/[\s,;]+/).filter(Boolean);
  const rounds = (word) => /^-?[0-9]+$/.test(word) && !Number.isSafeInteger(Number(word));
  if (!words.some(rounds)) return [{ point: point.name, values: words.map(Number) }];
  return words.map((text, at) => ({ point: point.name, at, text }));
}

async function write(point) {
  const isText = typeof point.values[0] === "string" && !/^-?[0-9.]+$/.test(point.values[0]);
  const sent = await ask(T.points.write(point.name), (done) => [h("form", { onsubmit: (event) => {
    event.preventDefault();
    done(bodies(point, isText, new FormData(event.target).get("values")));
  } },
    h("p", null, T.points.writeIntro(point.device)),
    field(T.points.values, input({ name: "values", value: isText ? point.values[0] : point.values.join(" "), required: !isText, pattern: isText ? '[^"]*' : "[\\-+0-9.eE\\s,;]+" })),
    h("p", { class: "actions" }, button(T.points.send, null, { type: "submit", class: "main" }), button(T.cancel, () => done())))]);
  for (const body of sent || []) await attempt(() => post("point", body), T.points.written(point.name));
  redraw();
}

function quality(point) {
  const good = /\bok/.test(point.status);
  return lamp(good ? "up" : point.age_s === null ? "idle" : "corrupt", point.status);
}

export const points = {
  id: "points",
  isOffered: () => app.status.points,
  draw: () => [h("h1", null, T.nav.points), table(T.nav.points,
    [T.points.name, T.points.device, T.points.value, T.points.trend, T.points.age, T.points.quality, may("operator") ? T.rules.change : ""],
    app.status.points.map((point) => ({ cells: [
      h("span", null, h("strong", null, point.label || point.name), point.label && h("small", null, ` ${point.name}`)),
      `${point.device} ${point.table} ${point.address}`,
      h("span", { class: "value" }, point.values.slice(0, VALUES_SHOWN).map((value) => value ?? "?").join("  ") + (point.values.length > VALUES_SHOWN ? " …" : "")),
      plot(point), point.age_s === null ? T.points.never : `${point.age_s} s`, quality(point),
      may("operator") && /coil|holding/.test(point.table) && button(T.points.writeShort, () => write(point), { "aria-label": T.points.write(point.name) })] })),
    T.points.none)],
};
