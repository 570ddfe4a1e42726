// Log-in.

import { attempt, follow, get, post } from "./api.js";
import { button, field, h, input } from "./dom.js";
import { app, redraw, take } from "./state.js";
import { T } from "./texts.js";

let loginFault = "";

/// Asks who has logged in.
export async function begin() {
  try {
    // The browser has asked for both while the scripts came.
    const [user, status] = await Promise.all([get("session"), get("status")]);
    app.user = user;
    take(status);
    follow();
  } catch (error) {
    if (error.status !== 401) loginFault = error.message;
  }
  app.known = true;
  redraw();
}

async function logIn(event) {
  event.preventDefault();
  const form = new FormData(event.target);
  try {
    await post("session", { user: form.get("user"), password: form.get("password") });
    loginFault = "";
    await begin();
  } catch (error) {
    loginFault = error.message;
    redraw();
  }
}

export function loginView() {
  return h("main", { class: "login", "data-key": "login" },
    h("form", { class: "card", onsubmit: logIn },
      h("h1", null, "mobgate"),
      h("p", { class: "quiet" }, T.login.intro),
      field(T.login.user, input({ name: "user", required: true, autocomplete: "username", autocapitalize: "none", autofocus: true })),
      field(T.login.password, input({ name: "password", type: "password", required: true, autocomplete: "current-password" })),
      h("p", { role: "alert", class: "fault" }, loginFault),
      button(T.login.submit, null, { type: "submit", class: "main" })));
}

export async function logOut() {
  if (await attempt(() => fetch("/api/v1/session", { method: "DELETE" }))) location.reload();
}
