// Overview: what is wrong first, then how the requests flow.

import { h, MARKS, v } from "./dom.js";
import { health, healthText, problems } from "./health.js";
import { app, isClient, isOpen, isServer, rate } from "./state.js";
import { T } from "./texts.js";

/// Sizes of the picture.
const BOX = 46;
const GAP = 16;
const LAMP = 30;
const narrow = matchMedia("(max-width: 760px)");

function problemList() {
  const found = problems();
  if (!found.length) return h("p", { class: "card good" }, h("span", { class: "lamp up", "aria-hidden": "true" }, MARKS.up), T.overview.well);
  return h("ul", { class: "problems" }, found.map(({ level, title, fix }) =>
    h("li", { class: `card ${["note", "warn", "bad"][level]}` }, h("strong", null, title), h("p", null, fix))));
}

/// A port with what is behind it.
function portsOf(side) {
  const { ports, rules, units } = app.status;
  const local = rules.some((rule) => rule.destination === "local");
  const list = ports.filter((port) => (side === "left" ? isServer(port) || port.role === "scanner" || port.role === "ethercat" : isClient(port)))
    .map((port) => ({
      name: port.port, text: [port.role, port.where, port.line].filter(Boolean).join(" · "), open: isOpen(port),
      units: side === "right" ? units.filter((unit) => unit.port === port.port) : [],
      rate: rate(`${side === "left" ? "from" : "to"} ${port.port}`),
    }));
  if (side === "right" && local) list.push({ name: "local", text: T.overview.local, open: true, units: [], rate: "" });
  return list;
}

const rowsOf = (port, width) => Math.ceil(port.units.length / Math.floor((width - 20) / LAMP));

function box(port, x, y, width) {
  const rows = rowsOf(port, width);
  const perRow = Math.floor((width - 20) / LAMP);
  const most = Math.floor((width - 24) / 6.6);
  const cut = port.text.length > most ? `${port.text.slice(0, most - 1)}…` : port.text;
  return v("g", { class: port.open ? "box" : "box closed" },
    v("rect", { x, y, width, height: BOX + rows * LAMP, rx: 8 }),
    v("text", { x: x + 12, y: y + 19, class: "name" }, port.name, !port.open && v("tspan", { class: "mark", dx: 8 }, `${MARKS.down} ${T.overview.closed}`)),
    v("text", { x: x + 12, y: y + 36, class: "small" }, cut),
    port.units.map((unit, at) => {
      const state = health(unit);
      const [cx, cy] = [x + 25 + (at % perRow) * LAMP, y + BOX + 10 + Math.floor(at / perRow) * LAMP];
      return v("g", { class: `unit ${state}` }, v("title", null, `${T.unit} ${unit.unit}: ${healthText(state)}`),
        v("circle", { cx, cy, r: 12 }), v("text", { x: cx, y: cy + 4, "text-anchor": "middle" }, unit.unit),
        state !== "up" && v("text", { x: cx + 10, y: cy - 6, class: "mark" }, MARKS[state]));
    }));
}

function arrow(path, x, y, port, anchor) {
  return v("g", { class: port.rate ? "arrow busy" : port.open ? "arrow" : "arrow closed" },
    v("path", { d: path, "marker-end": "url(#head)" }),
    port.rate && v("text", { x, y, "text-anchor": anchor, class: "small" }, `${port.rate}/s`));
}

const heightOf = (list, width) => list.reduce((sum, port) => sum + BOX + rowsOf(port, width) * LAMP + GAP, 0);

function wide(left, right) {
  const [width, side, middle] = [920, 310, 110];
  const height = Math.max(heightOf(left, side), heightOf(right, side), 90);
  const column = (list, x, toRouter) => {
    let y = Math.max(0, (height - heightOf(list, side)) / 2) + GAP / 2;
    return list.map((port) => {
      const tall = BOX + rowsOf(port, side) * LAMP;
      const [at, top] = [y + tall / 2, y];
      y += tall + GAP;
      const [from, to] = toRouter ? [side, (width - middle) / 2 - 2] : [(width + middle) / 2, width - side - 2];
      return [box(port, x, top, side), arrow(`M${from} ${at}H${to}`, (from + to) / 2, at - 7, port, "middle")];
    });
  };
  return [width, height, [column(left, 0, true), column(right, width - side, false),
    v("g", { class: "box router" }, v("rect", { x: (width - middle) / 2, y: GAP / 2, width: middle, height: height - GAP, rx: 8 }),
      v("text", { x: width / 2, y: height / 2 + 4, "text-anchor": "middle", class: "name" }, T.overview.router))]];
}

function tall(left, right) {
  const [width, turn] = [330, 44];
  let y = 1;
  const stack = (list) => list.map((port) => {
    const at = y;
    y += BOX + rowsOf(port, width - 2) * LAMP + 8;
    return box(port, 1, at, width - 2);
  });
  const down = (list) => {
    const at = y;
    y += turn;
    const sum = list.reduce((rates, port) => rates + Number(port.rate || 0), 0);
    return arrow(`M${width / 2} ${at - 4}V${at + turn - 10}`, width / 2 + 12, at + 22, { open: true, rate: sum ? sum.toFixed(1) : "" }, "start");
  };
  const parts = [stack(left), left.length > 0 && down(left)];
  parts.push(v("g", { class: "box router" }, v("rect", { x: 1, y, width: width - 2, height: 36, rx: 8 }),
    v("text", { x: width / 2, y: y + 23, "text-anchor": "middle", class: "name" }, T.overview.router)));
  y += 40;
  parts.push(right.length > 0 && down(right), stack(right));
  return [width, y + 2, parts];
}

function picture() {
  const [left, right] = [portsOf("left"), portsOf("right")];
  if (!left.length && !right.length) return h("p", { class: "empty" }, T.overview.empty, " ", h("a", { href: "#/setup" }, T.nav.setup));
  const [width, height, parts] = narrow.matches ? tall(left, right) : wide(left, right);
  const told = T.overview.picture(left.map((port) => port.name), right.map((port) => port.name));
  return h("div", { class: "card" }, v("svg", { class: "flow", viewBox: `-1 -1 ${width + 2} ${height + 2}`, role: "img", "aria-label": told },
    v("defs", null, v("marker", { id: "head", viewBox: "0 0 8 8", refX: 7, refY: 4, markerWidth: 8, markerHeight: 8, markerUnits: "userSpaceOnUse", orient: "auto" },
      v("path", { d: "M0 0L8 4L0 8z" }))), parts));
}

function lampLegend() {
  return h("p", { class: "legend" }, ["up", "slow", "corrupt", "down"].map((state) =>
    h("span", { class: `lamp ${state}` }, h("span", { "aria-hidden": "true" }, MARKS[state]), healthText(state))));
}

export const overview = {
  id: "overview",
  draw: () => [h("h1", null, T.nav.overview), problemList(), h("h2", null, T.overview.flow), picture(), lampLegend(),
    h("p", { class: "quiet" }, app.status.version)],
};
