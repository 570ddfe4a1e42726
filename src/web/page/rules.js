// Rules: the table in its order, in words, and what it does with a request.

import { attempt, get, post, text } from "./api.js";
import { change } from "./commit.js";
import { ask, button, confirmed, field, h, input, select, table } from "./dom.js";
import { app, isClient, isServer, may, redraw, tell } from "./state.js";
import { T } from "./texts.js";

let rows = [];
let ruleText = "";
/// Likely mistakes in the rules of the candidate, by their numbers.
let marks = new Map();
let dragged = null;
let tested = null;

/// The rules of the candidate, or those in force.
async function loadRules() {
  const isOpen = app.status.candidate === "open";
  const path = isOpen ? "settings/candidate" : "settings";
  ruleText = await text(path).catch(() => text("settings"));
  marks = new Map(isOpen ? (await get("settings/diff").catch(() => ({ rules: [] }))).rules.map(({ rule, message }) => [rule, message]) : []);
  rows = ruleText.split("\n").filter((line) => line.startsWith("route ")).map((line) => {
    const [, source, units, ip, tag, destination, ...policy] = line.split(/ +/);
    return { source, units, ip, tag, destination, policy: policy.join(" ") };
  });
  redraw();
}

async function reload() {
  await attempt(loadRules);
}

const move = async (from, to) => {
  if (from !== to && to >= 0 && to < rows.length && await change([`move route ${from + 1} ${to + 1}`])) await reload();
};

/// A rule as a sentence.
function inWords({ source, units, ip, tag, destination, policy }) {
  const whose = ip === "*" ? "" : ` ${T.rules.from} ${ip}`;
  const id = tag === "*" ? "" : tag.startsWith("=") ? `, ${T.rules.becomes} ${tag.slice(1)}` : `, ${T.rules.shifted} ${tag}`;
  const to = T.rules.destinations[destination] || `${T.rules.to} ${destination}`;
  return `${T.rules.requests} ${source}${whose} ${T.rules.for} ${units === "*" ? T.rules.all : units} ${to}${id}${policy ? `; ${policy}` : ""}.`;
}

const warningOf = (at) => (app.status.candidate === "open" ? marks.get(at + 1) : app.status.rules[at]?.policy.split("  # ")[1]);

function ruleForm(rule, done) {
  const { ports } = app.status;
  const sources = ports.filter((port) => isServer(port) || port.role === "scanner" || port.role === "ethercat").map((port) => port.port);
  const to = [...ports.filter(isClient).map((port) => port.port), "local", "discard", "nopath"];
  return [h("form", { class: "grid", onsubmit: (event) => {
    event.preventDefault();
    const form = new FormData(event.target);
    done(["source", "units", "ip", "tag", "destination", "policy"].map((name) => form.get(name).trim()).join(" "));
  } },
    field(T.rules.source, select({ name: "source", value: rule.source || sources[0] }, sources)),
    field(T.devices.units, input({ name: "units", value: rule.units, required: true }), T.rules.unitsHint),
    field(T.rules.ip, input({ name: "ip", value: rule.ip, required: true }), T.rules.ipHint),
    field(T.rules.tag, input({ name: "tag", value: rule.tag, required: true }), T.rules.tagHint),
    field(T.rules.destination, select({ name: "destination", value: rule.destination || to[0] }, to)),
    field(T.rules.policy, input({ name: "policy", value: rule.policy }), T.rules.policyHint),
    h("p", { class: "actions" }, button(T.rules.put, null, { type: "submit", class: "main" }), button(T.cancel, () => done())))];
}

const FRESH = { source: "", units: "*", ip: "*", tag: "*", destination: "", policy: "" };

async function edit(at) {
  const line = await ask(at === null ? T.rules.add : T.rules.edit, (done) => ruleForm(at === null ? FRESH : rows[at], done));
  if (line && await change([at === null ? `route ${line}` : `edit route ${at + 1} ${line}`])) await reload();
}

async function remove(at) {
  if (await confirmed(T.rules.remove, inWords(rows[at]), T.rules.remove, T.cancel) && await change([`delete route ${at + 1}`])) await reload();
}

function ruleRow(rule, at) {
  const warning = warningOf(at);
  const can = may("engineer");
  const tools = can && h("span", { class: "tools" },
    button("↑", () => move(at, at - 1), { "aria-label": T.rules.up(at + 1), disabled: at === 0 }),
    button("↓", () => move(at, at + 1), { "aria-label": T.rules.down(at + 1), disabled: at === rows.length - 1 }),
    button(T.rules.editShort, () => edit(at), { "aria-label": `${T.rules.edit} ${at + 1}` }),
    button(T.rules.removeShort, () => remove(at), { "aria-label": `${T.rules.remove} ${at + 1}` }));
  return {
    props: {
      class: [dragged === at && "dragged", warning && "dead", tested?.rule === at + 1 && "hit"].filter(Boolean).join(" "),
      draggable: can ? "true" : "false",
      ondragstart: (event) => { dragged = at; event.dataTransfer.effectAllowed = "move"; event.dataTransfer.setData("text/plain", `${at}`); },
      ondragover: (event) => dragged !== null && event.preventDefault(),
      ondrop: (event) => { event.preventDefault(); const from = dragged; dragged = null; move(from, at); },
      ondragend: () => { dragged = null; redraw(); },
    },
    cells: [at + 1, rule.source, rule.units, rule.ip, rule.tag, rule.destination,
      h("span", { class: "words" }, inWords(rule), warning && h("strong", { class: "fault" }, ` ${T.rules.never} ${warning}`)), tools],
  };
}

async function test(event) {
  event.preventDefault();
  const form = new FormData(event.target);
  const number = (name) => (form.get(name) === "" ? undefined : Number(form.get(name)));
  const request = { port: form.get("port"), unit: number("unit"), function: number("function"), address: number("address"), from: form.get("from") || undefined };
  tested = null;
  await attempt(async () => { tested = await (await post("explain", request)).json(); });
  redraw();
}

function tester() {
  const sources = app.status.ports.filter((port) => isServer(port) || port.role === "scanner").map((port) => port.port);
  if (!sources.length) return null;
  return h("section", { class: "card" }, h("h2", null, T.rules.tester), h("p", { class: "quiet" }, T.rules.testerIntro),
    h("form", { class: "row", onsubmit: test },
      field(T.rules.source, select({ name: "port" }, sources)),
      field(T.unit, input({ name: "unit", type: "number", min: 0, max: 255, value: "1", required: true })),
      field(T.rules.function, select({ name: "function", value: "3" }, Object.entries(T.functions))),
      field(T.rules.address, input({ name: "address", type: "number", min: 0, max: 65535 })),
      field(T.rules.fromAddress, input({ name: "from", placeholder: "192.168.1.7" })),
      button(T.rules.test, null, { type: "submit" })),
    h("p", { role: "status", class: "told" }, tested && [`${T.rules.outcomes[tested.outcome]} `, h("span", { class: "quiet" }, tested.text)]));
}

export const rules = {
  id: "rules",
  load: loadRules,
  every: 3000,
  draw: () => [
    h("h1", null, T.nav.rules), h("p", { class: "quiet" }, T.rules.intro),
    table(T.nav.rules, ["#", T.rules.source, T.devices.units, T.rules.ip, T.rules.tag, T.rules.destination, T.rules.meaning, may("engineer") ? T.rules.change : ""],
      rows.map(ruleRow), T.rules.none),
    may("engineer") && h("p", { class: "actions" }, button(T.rules.add, () => edit(null), { class: "main" })),
    tester(),
  ],
};
