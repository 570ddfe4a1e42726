// Users: who may log in, with which role, and their passwords.

import { attempt, get, post } from "./api.js";
import { change } from "./commit.js";
import { ask, button, confirmed, field, h, input, select, table } from "./dom.js";
import { app, may, redraw } from "./state.js";
import { T } from "./texts.js";

let known = [];

async function loadUsers() {
  known = (await get("users")).users;
  redraw();
}

async function setPassword(name) {
  const password = await ask(T.users.passwordOf(name), (done) => [h("form", { onsubmit: (event) => {
    event.preventDefault();
    const form = new FormData(event.target);
    if (form.get("one") === form.get("two")) done(form.get("one"));
    else event.target.querySelector(".fault").textContent = T.users.differ;
  } },
    field(T.users.newPassword, input({ name: "one", type: "password", minlength: 8, maxlength: 64, required: true, autocomplete: "new-password" }), T.users.length),
    field(T.users.again, input({ name: "two", type: "password", minlength: 8, maxlength: 64, required: true, autocomplete: "new-password" })),
    h("p", { role: "alert", class: "fault" }),
    h("p", { class: "actions" }, button(T.users.set, null, { type: "submit", class: "main" }), button(T.cancel, () => done())))]);
  if (password) await attempt(() => post("password", { user: name, password }), T.users.wasSet(name));
  await attempt(loadUsers);
}

async function addUser(event) {
  event.preventDefault();
  const form = new FormData(event.target);
  await change([`user ${form.get("name")} role ${form.get("role")}`]);
}

async function removeUser(name) {
  if (await confirmed(T.users.remove, name, T.users.remove, T.cancel)) await change([`delete user ${name}`]);
}

export const users = {
  id: "users",
  load: loadUsers,
  every: 3000,
  draw: () => [
    h("h1", null, T.nav.users), h("p", { class: "quiet" }, T.users.intro),
    table(T.nav.users, [T.users.name, T.users.role, T.users.password, may("engineer") ? T.rules.change : ""], known.map((user) => ({ cells: [
      user.name, T.roles[user.role] || user.role, user.password, may("engineer") && h("span", { class: "tools" },
        button(T.users.setShort, () => setPassword(user.name), { "aria-label": `${T.users.setShort}: ${user.name}` }),
        user.name !== app.user.user && button(T.rules.removeShort, () => removeUser(user.name), { "aria-label": `${T.users.remove} ${user.name}` }))] })), T.users.none),
    may("engineer") && h("section", { class: "card" }, h("h2", null, T.users.add), h("form", { class: "row", onsubmit: addUser },
      field(T.users.name, input({ name: "name", required: true, maxlength: 15, pattern: "[A-Za-z][A-Za-z0-9_.\\-]*", autocapitalize: "none" })),
      field(T.users.role, select({ name: "role" }, Object.entries(T.roles))),
      button(T.users.addShort, null, { type: "submit" })), h("p", { class: "quiet" }, T.users.addHint)),
  ],
};
