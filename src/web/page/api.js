// The calls of /api/v1, and the status as it comes.

import { app, redraw, take, tell } from "./state.js";
import { T } from "./texts.js";

/// Longest silence of the events before the page says that the connection is lost, in milliseconds.
const SILENCE = 5000;

/// Calls; fails with an `Error` that has the message of the gateway, and its `status`.
export async function call(method, path, body, options) {
  const headers = {};
  if (body !== undefined) headers["Content-Type"] = typeof body === "string" ? "text/plain" : "application/json";
  let response;
  try {
    const content = typeof body === "string" || body === undefined ? body : JSON.stringify(body);
    response = await fetch(`/api/v1/${path}`, { method, headers, body: content, ...options });
  } catch (error) {
    if (error.name !== "AbortError") error.message = T.unreachable;
    throw error;
  }
  if (response.ok) return response;
  const told = await response.json().then((json) => json.error, () => ({ message: response.statusText }));
  if (response.status === 401 && path !== "session" && app.user) leave();
  if (response.status === 403 && path !== "session") refreshUser();
  // The column is that of a line that nobody has typed.
  throw Object.assign(new Error(told.message.replace(/^column \d+: /, "")), { status: response.status, told });
}

/// Asks for the user's role once more: somebody may have changed it.
async function refreshUser() {
  app.user = await get("session").catch(() => app.user);
  redraw();
}

export const get = async (path) => (await call("GET", path)).json();
export const text = async (path) => (await call("GET", path)).text();
export const post = (path, body) => call("POST", path, body);

/// Does it, and tells what went wrong; returns whether all went well.
export async function attempt(work, done) {
  try {
    await work();
    if (done) tell(done);
    return true;
  } catch (error) {
    tell(error.message, "bad");
    return false;
  }
}

/// Sends `body`, and hands over each line of the response as it comes.
export async function lines(path, body, each) {
  const reader = (await post(path, body)).body.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const { value, done } = await reader.read();
    const all = (rest + (value || "")).split("\n");
    rest = done ? "" : all.pop();
    all.filter((line) => line.trim()).forEach(each);
    if (done) return;
  }
}

/// Sends a file, and tells how much of it has gone, from 0 to 1; the promise has the response.
export function upload(path, file, progress) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("POST", `/api/v1/${path}`);
    request.setRequestHeader("Content-Type", "application/octet-stream");
    request.responseType = "json";
    request.upload.onprogress = ({ loaded, total }) => progress(loaded / total);
    request.onload = () => (request.status === 200 ? resolve(request.response) : reject(new Error(request.response?.error?.message || request.statusText)));
    request.onerror = () => reject(new Error(T.unreachable));
    request.send(file);
  });
}

/// The session has ended.
export function leave() {
  app.user = null;
  app.status = null;
  events?.close();
  events = null;
  redraw();
}

let events = null;
/// Milliseconds at which the events were asked for.
let asked = 0;

/// Follows the status. An event stream ends now and then and comes back by itself; where there are too many, the status is asked for.
export function follow() {
  events?.close();
  asked = performance.now();
  const source = new EventSource("/api/v1/events");
  events = source;
  source.onmessage = (event) => {
    app.polled = false;
    take(JSON.parse(event.data));
  };
  source.onerror = () => {
    if (source.readyState !== EventSource.CLOSED || events !== source) return;
    setTimeout(async () => {
      if (events !== source || !app.user) return;
      await get("status").then((status) => {
        app.polled = true;
        take(status);
      }, () => {});
      if (events === source && app.user) follow();
    }, 2000);
  };
}

// Says that nothing has come for some time, and asks again: a gateway that has lost its power ends no connection.
setInterval(() => {
  const now = performance.now();
  const lost = Boolean(app.user) && now - app.heard > SILENCE;
  if (lost && now - asked > SILENCE) follow();
  if (lost !== app.lost) {
    app.lost = lost;
    redraw();
  }
}, 1000);
