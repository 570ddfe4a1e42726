// The wizard: from a line with unknown devices to a working gateway, in three steps.

import { attempt, get } from "./api.js";
import { applyAll } from "./commit.js";
import { button, field, h, input, select } from "./dom.js";
import { foundTable, scanForm, serialClients, takeOver } from "./devices.js";
import { app, isClient, isOpen, may, redraw } from "./state.js";
import { T } from "./texts.js";
import { runWork, work, workPanel } from "./work.js";

let step = 1;
let line = null;
let doneWith = null;
/// The serial lines of the gateway; `null` until they are known.
let serialLines = null;

async function loadLines() {
  serialLines = await get("lines").then((response) => response.lines, () => serialLines || []);
  redraw();
}

/// Whether nothing is set up: the page then begins here.
export const isFresh = () => may("engineer") && !app.status.ports.some((port) => isClient(port));

const freeName = (letter) => {
  for (let nth = 1; ; nth += 1) if (!app.status.ports.some((port) => port.port === `${letter}${nth}`)) return `${letter}${nth}`;
};

const go = (to) => { step = to; redraw(); };

async function chooseLine(event) {
  event.preventDefault();
  const form = new FormData(event.target);
  const taken = form.get("line");
  event.target.elements.device.required = !taken;
  if (!event.target.reportValidity()) return;
  line = taken || freeName("P");
  const made = `port ${line} serial ${form.get("device")} rtu client 19200 8E1`;
  if (taken || await attempt(() => applyAll([made]))) go(2);
}

function firstStep() {
  if (!serialLines) return h("p", { class: "quiet" }, T.loading);
  const there = serialClients().map((port) => port.port);
  const free = serialLines.filter(({ port }) => port === "-").map(({ line }) => line);
  // A board's lines have no paths.
  const hint = (!serialLines[0] || serialLines[0].line.startsWith("/")) && T.setup.deviceHint;
  return h("form", { onsubmit: chooseLine },
    h("p", null, T.setup.lineIntro),
    there.length > 0 && field(T.setup.existing, select({ name: "line" }, [...there.map((name) => [name, name]), ["", T.setup.another]])),
    field(T.setup.device, input({ name: "device", value: free[0] || "", pattern: "\\S+", required: !there.length, list: "lines" }), hint),
    h("datalist", { id: "lines" }, free.map((value) => h("option", { value }))),
    h("p", { class: "actions" }, button(T.setup.next, null, { type: "submit", class: "main" })));
}

async function giveUpLine() {
  if (await attempt(() => applyAll([`delete port ${line}`]))) go(1);
}

function secondStep() {
  const port = app.status.ports.find((known) => known.port === line);
  if (port && !isOpen(port)) {
    return [h("p", { class: "card bad", role: "alert" }, T.portFails(port.port, port.status)),
      h("p", { class: "actions" }, button(T.setup.otherDevice, giveUpLine, { class: "main" }))];
  }
  const found = work.kind === "scan" && work.found.length > 0 && !work.running;
  return [h("p", null, T.setup.scanIntro),
    !work.running && scanForm(line, (request) => runWork("scan", request)),
    work.kind === "scan" && [workPanel(), foundTable()],
    h("p", { class: "actions" }, button(T.setup.next, () => go(3), { class: "main", disabled: !found }), !work.running && button(T.setup.otherDevice, giveUpLine))];
}

async function finish(event) {
  event.preventDefault();
  const form = new FormData(event.target);
  const server = app.status.ports.some((port) => port.port === "P502") ? freeName("T") : "P502";
  const readonly = form.get("readonly") ? " readonly" : "";
  const lines = takeOver(server).map((made) => (made.startsWith("route ") ? made + readonly : made));
  lines.splice(1, 0, `port ${server} tcp server ${form.get("port")}`);
  if (await attempt(() => applyAll(lines))) {
    doneWith = { port: form.get("port"), unit: Math.min(...work.found.map(({ unit }) => unit)) };
    go(4);
  }
}

function thirdStep() {
  return h("form", { onsubmit: finish },
    h("p", null, T.setup.serverIntro(work.found.length)), foundTable(),
    field(T.setup.tcpPort, input({ name: "port", type: "number", min: 1, max: 65535, value: "502", required: true }), T.setup.tcpHint),
    h("label", { class: "check" }, h("input", { type: "checkbox", name: "readonly" }), ` ${T.setup.readonly}`),
    h("p", { class: "actions" }, button(T.setup.commit, null, { type: "submit", class: "main" }), button(T.setup.previous, () => go(2))));
}

function lastStep() {
  return [h("p", { class: "card good" }, T.setup.done), h("p", null, T.setup.tryIt),
    h("pre", { tabindex: 0 }, `mbpoll -m tcp -p ${doneWith.port} -a ${doneWith.unit} -t 4 -r 1 -c 1 -1 ${location.hostname}`),
    h("p", { class: "actions" }, h("a", { class: "button main", href: "#/overview" }, T.setup.toOverview))];
}

export const setup = {
  id: "setup",
  isOffered: () => may("engineer"),
  load: loadLines,
  leave: () => {
    serialLines = null;
    if (step === 4) step = 1;
  },
  draw: () => [
    h("h1", null, T.nav.setup),
    h("ol", { class: "steps" }, T.setup.steps.map((name, at) => h("li", { class: at + 1 === step ? "now" : at + 1 < step ? "past" : "", "aria-current": at + 1 === step && "step" }, name))),
    h("section", { class: "card", "data-key": `step${step}` }, [firstStep, secondStep, thirdStep, lastStep][step - 1]()),
  ],
};
