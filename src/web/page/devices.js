// Devices: how each unit does, and the work of finding and measuring them.

import { attempt, get } from "./api.js";
import { button, field, h, input, lamp, select, table, v } from "./dom.js";
import { health, healthText, lineErrors } from "./health.js";
import { change } from "./commit.js";
import { app, isClient, may, rate, redraw } from "./state.js";
import { T } from "./texts.js";
import { ranges, runWork, work, workPanel } from "./work.js";

const BAUDS = [9600, 19200, 38400, 115200, 57600, 4800, 2400, 1200];

/// Serial lines on which the gateway asks.
export const serialClients = () => app.status.ports.filter((port) => /^(rtu|ascii) client$/.test(port.role));

/// Classes of response times: the end of the first in milliseconds, and the growth from one to the next.
const [CLASS_END, CLASS_GROWTH] = [0.5, 2 ** (2 / 3)];
/// Minutes between two marks of the counters of errors.
const SPAN_MINUTES = 5;

let chosen = null;
let pictures = [];

async function loadPictures() {
  pictures = (await get("units")).units;
  redraw();
}

const end = (nth) => {
  const time = CLASS_END * CLASS_GROWTH ** nth;
  return time < 10 ? `${Number(time.toFixed(1))} ms` : time < 1000 ? `${Math.round(time)} ms` : `${Number((time / 1000).toFixed(1))} s`;
};

/// Columns, the highest as high as the picture.
function columns(counts, text, bad) {
  const most = Math.max(...counts, 1);
  return v("svg", { class: bad ? "columns bad" : "columns", viewBox: `0 0 ${counts.length * 10} 40`, preserveAspectRatio: "none", role: "img", "aria-label": text },
    counts.map((count, nth) => count > 0 && v("rect", { x: nth * 10 + 1, y: 40 - Math.max(2, (40 * count) / most), width: 8, height: Math.max(2, (40 * count) / most) })));
}

/// How many responses took how long: the classes from the first to the last in use.
function histogram(times) {
  const counts = times.split(" ").map(Number);
  const [first, last] = [counts.findIndex(Boolean), counts.findLastIndex(Boolean)];
  if (first < 0) return null;
  const from = Math.max(0, first - 1);
  const shown = counts.slice(from, last + 2);
  const top = counts.indexOf(Math.max(...counts));
  return h("figure", { class: "picture" }, columns(shown, T.devices.histogram(end(top - 1), end(top))),
    h("figcaption", { class: "ends" }, h("span", null, from ? end(from - 1) : "0"), h("span", null, end(from + shown.length - 1))));
}

/// The errors of the last hour by kind, five minutes a column.
function hourOfErrors(errors) {
  const kinds = errors.split(", ").filter(Boolean).map((text) => {
    const [kind, ...counts] = text.split(" ");
    return { kind, counts: counts.map(Number) };
  });
  if (!kinds.length) return h("p", { class: "quiet" }, T.devices.quietHour);
  return h("ul", { class: "bars hour" }, kinds.map(({ kind, counts }) => {
    const sum = counts.reduce((one, other) => one + other, 0);
    const last = counts.findLastIndex(Boolean);
    return h("li", null, h("span", null, kind), columns(counts, T.devices.hourOf(kind, sum, (counts.length - 1 - last) * SPAN_MINUTES), true), h("span", null, `${sum}`));
  }), h("li", null, h("span"), h("span", { class: "ends" }, h("span", null, T.devices.hourAgo), h("span", null, T.devices.now)), h("span")));
}

const ms = (text) => (text.endsWith("ms") ? parseFloat(text) : text.endsWith("us") ? parseFloat(text) / 1000 : parseFloat(text) * 1000) || 0;

function bars(items, most) {
  return h("ul", { class: "bars" }, items.map(({ name, value, text, bad }) =>
    h("li", null, h("span", null, name), v("svg", { viewBox: "0 0 100 1", preserveAspectRatio: "none", "aria-hidden": "true", class: bad && "bad" }, v("rect", { width: (100 * value) / (most || 1), height: 1 })), h("span", null, text))));
}

function details(unit) {
  const times = [["p50", T.devices.median], ["p99", T.devices.most], ["last", T.devices.last]]
    .map(([key, name]) => ({ name, value: ms(unit[key]), text: unit[key] }));
  const errors = lineErrors(unit).map(({ kind, count }) => ({ name: kind, value: count, text: `${count}`, bad: true }));
  const picture = pictures.find((known) => known.port === unit.port && known.unit === unit.unit);
  return h("section", { class: "card", "aria-label": T.devices.about(unit.unit, unit.port) },
    h("h2", null, T.devices.about(unit.unit, unit.port)),
    h("h3", null, T.devices.times), picture && histogram(picture.times), bars(times, Math.max(...times.map(({ value }) => value))),
    h("h3", null, T.devices.hour), hourOfErrors(picture?.errors || ""),
    h("h3", null, T.devices.errors),
    errors.length ? bars(errors, Math.max(...errors.map(({ value }) => value))) : h("p", { class: "quiet" }, T.devices.noErrors),
    errors.map(({ name }) => T.fixes[name] && h("p", null, h("strong", null, `${name}: `), T.fixes[name])));
}

function unitTable() {
  const heads = [T.unit, T.port, T.devices.state, ...["requests", "perSecond", "median", "most", "failed"].map((key) => ({ text: T.devices[key], right: true }))];
  return table(T.nav.devices, heads, app.status.units.map((unit) => {
    const id = `${unit.port} ${unit.unit}`;
    const state = health(unit);
    return { cells: [
      button(`${unit.unit}`, () => { chosen = chosen === id ? null : id; redraw(); attempt(loadPictures); }, { class: "link", "aria-expanded": `${chosen === id}`, "aria-label": T.devices.about(unit.unit, unit.port) }),
      unit.port, lamp(state, healthText(state)), unit.requests, rate(`unit ${unit.port} ${unit.unit}`) || "0", unit.p50, unit.p99, unit.timeouts + unit.exceptions] };
  }), T.devices.none);
}

/// The choice of speeds and units for a scan.
export function scanForm(port, start) {
  return h("form", { class: "row", onsubmit: (event) => {
    event.preventDefault();
    const form = new FormData(event.target);
    const bauds = form.getAll("baud").map(Number);
    start({ port: port || form.get("port"), units: form.get("units"), ...(bauds.length && { bauds }) });
  } },
    !port && field(T.port, select({ name: "port" }, serialClients().map((line) => line.port))),
    h("fieldset", null, h("legend", null, T.devices.speeds), BAUDS.map((baud) =>
      h("label", { class: "check" }, h("input", { type: "checkbox", name: "baud", value: baud, checked: baud === 9600 || baud === 19200 }), ` ${baud}`))),
    field(T.devices.units, input({ name: "units", value: "1-32", pattern: "\\d{1,3}(-\\d{1,3})?", required: true, size: 8 }), T.devices.unitsHint),
    button(T.devices.scan, null, { type: "submit", class: "main", disabled: work.running }));
}

/// What a scan has found.
export function foundTable() {
  return table(T.devices.found, [T.unit, T.devices.speed, T.devices.took, T.devices.response],
    work.found.map(({ unit, speed, took, about }) => ({ cells: [unit, speed, took, about] })), work.running ? T.devices.notYet : T.devices.nothing);
}

/// The lines that take a scan over: the speed at which most were found, and rules for clients of `source`.
export function takeOver(source) {
  const speeds = work.found.map(({ speed }) => speed);
  const speed = speeds.sort((one, other) => speeds.filter((s) => s === other).length - speeds.filter((s) => s === one).length)[0];
  const units = work.found.filter((unit) => unit.speed === speed).map(({ unit }) => unit);
  return [`edit port ${work.port} ${speed}`, ...(source ? ranges(units).map((span) => `route ${source} ${span} * * ${work.port}`) : [])];
}

async function takeFound() {
  const { ports, rules } = app.status;
  const routed = rules.some((rule) => rule.destination === work.port);
  const source = ports.find((port) => /^(tcp|udp|rtu|ascii) server$/.test(port.role));
  if (await change(takeOver(routed ? null : source?.port))) { work.kind = null; redraw(); }
}

function scanPanel() {
  if (!may("engineer")) return null;
  if (!serialClients().length) return h("p", { class: "quiet" }, T.devices.noLine, " ", h("a", { href: "#/setup" }, T.nav.setup));
  return h("section", { class: "card" }, h("h2", null, T.devices.scanTitle), h("p", { class: "quiet" }, T.devices.scanIntro),
    !work.running && scanForm(null, (request) => runWork("scan", request)),
    work.kind === "scan" && [workPanel(), foundTable(),
      !work.running && work.found.length > 0 && h("p", { class: "actions" }, button(T.devices.take, takeFound, { class: "main" }))]);
}

function tunePanel() {
  if (!may("engineer") || !serialClients().length) return null;
  return h("section", { class: "card" }, h("h2", null, T.devices.tuneTitle), h("p", { class: "quiet" }, T.devices.tuneIntro),
    !work.running && h("form", { class: "row", onsubmit: (event) => {
      event.preventDefault();
      const form = new FormData(event.target);
      runWork("tune", { port: form.get("port"), count: Number(form.get("count")) });
    } },
      field(T.port, select({ name: "port" }, serialClients().map((line) => line.port))),
      field(T.devices.count, input({ name: "count", type: "number", min: 10, max: 20000, value: "500", required: true })),
      button(T.devices.tune, null, { type: "submit" })),
    work.kind === "tune" && [workPanel(), !work.running && work.proposed.length > 0 && [
      h("pre", { tabindex: 0 }, work.proposed.join("\n")),
      h("p", { class: "actions" }, button(T.devices.take, () => change(work.proposed), { class: "main" }))]]);
}

export const devices = {
  id: "devices",
  load: loadPictures,
  every: 5000,
  draw: () => {
    const unit = app.status.units.find((known) => `${known.port} ${known.unit}` === chosen);
    return [h("h1", null, T.nav.devices), unitTable(), unit && details(unit),
      app.status.ports.some(isClient) || app.status.units.length ? null : h("p", null, h("a", { href: "#/setup" }, T.nav.setup)), scanPanel(), tunePanel()];
  },
};
