// The page: what is around the views, and which of them is shown.

import { attempt } from "./api.js";
import { candidateBar } from "./commit.js";
import { devices } from "./devices.js";
import { button, h, morph } from "./dom.js";
import { ethercat } from "./ethercat.js";
import { firmware } from "./firmware.js";
import { frames } from "./frames.js";
import { log } from "./log.js";
import { begin, loginView, logOut } from "./login.js";
import { network } from "./network.js";
import { overview } from "./overview.js";
import { points } from "./points.js";
import { rules } from "./rules.js";
import { settings } from "./settings.js";
import { isFresh, setup } from "./setup.js";
import { app, redraw } from "./state.js";
import { T } from "./texts.js";
import { users } from "./users.js";

const VIEWS = [overview, devices, rules, points, ethercat, frames, log, network, users, settings, firmware, setup];
const NOTICE_TIME = 8000;

let view = null;
let timer = null;
let noticed = null;

/// The views that this gateway and this user have.
const offered = () => VIEWS.filter((known) => known.isOffered?.() ?? true);

function show(id) {
  const next = offered().find((known) => known.id === id) || overview;
  if (next === view) return;
  view?.leave?.();
  view = next;
  clearInterval(timer);
  app.changed = () => view.load && attempt(view.load);
  app.changed();
  if (view.every) timer = setInterval(() => view.load().catch(() => {}), view.every);
  requestAnimationFrame(() => document.querySelector("nav [aria-current]")?.scrollIntoView({ block: "nearest", inline: "center" }));
  document.title = `${T.nav[view.id]} · mobgate`;
}

function navigation() {
  return h("nav", { "aria-label": T.navigation }, h("ul", null, offered().map(({ id }) =>
    h("li", null, h("a", { href: `#/${id}`, "aria-current": id === view.id && "page" }, T.nav[id])))));
}

function notice() {
  if (app.notice !== noticed) {
    noticed = app.notice;
    if (noticed) setTimeout(() => { if (app.notice === noticed) { app.notice = null; redraw(); } }, NOTICE_TIME);
  }
  return h("div", { class: "notices", role: "status" }, app.notice && h("p", { class: `notice ${app.notice.kind}` }, app.notice.text,
    button("×", () => { app.notice = null; redraw(); }, { "aria-label": T.close })));
}

function skip(event) {
  event.preventDefault();
  document.getElementById("main").focus();
}

app.draw = () => {
  const root = document.getElementById("app");
  if (!app.known) return;
  if (!app.user || !app.status) {
    view = null;
    clearInterval(timer);
    morph(root, [loginView()]);
    return;
  }
  if (!view) show(location.hash.slice(2) || (isFresh() ? setup.id : overview.id));
  morph(root, [
    h("a", { class: "skip", href: "#main", onclick: skip }, T.skip),
    h("header", null, h("a", { class: "brand", href: "#/overview" }, "mobgate"),
      h("span", { class: app.lost ? "live lost" : "live" }, app.lost ? T.lost : T.live),
      h("span", { class: "who" }, `${app.user.user} (${T.roles[app.user.role]})`), button(T.logOut, logOut)),
    navigation(),
    h("main", { id: "main", tabindex: -1 },
      h("div", { role: "alert" }, app.lost && h("p", { class: "bar bad" }, T.lostLong)),
      app.polled ? h("p", { class: "bar" }, T.polled) : h("div", { hidden: true }),
      candidateBar() || h("div", { hidden: true }), notice(),
      h("div", { "data-key": view.id }, view.draw().flat(9).filter(Boolean))),
  ]);
};

addEventListener("hashchange", () => {
  if (!app.user || !app.status) return;
  show(location.hash.slice(2));
  redraw();
  scrollTo(0, 0);
});
matchMedia("(max-width: 760px)").addEventListener("change", redraw);
begin();
