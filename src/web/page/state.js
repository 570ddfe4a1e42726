// What the views show: who has logged in, the gateway's status second by second, and what was computed from it.

const HISTORY = 120;

export const app = {
  user: null,
  /// The session was asked for.
  known: false,
  status: null,
  /// Milliseconds of the last status.
  heard: 0,
  lost: false,
  /// As many pages as can be have live values: this one asks now and then.
  polled: false,
  /// A message for the user, which the next one replaces.
  notice: null,
  /// Requests a second, by unit, port of clients, and device.
  rates: new Map(),
  /// The last values of each point.
  history: new Map(),
};

let before = null;
let drawing = null;

/// Draws the page with the next frame; main.js says how.
export function redraw() {
  if (!drawing) {
    drawing = requestAnimationFrame(() => {
      drawing = null;
      app.draw();
    });
  }
}

/// Tells the user something.
export function tell(text, kind = "good") {
  app.notice = { text, kind };
  redraw();
}

const ROLES = ["viewer", "operator", "engineer"];

/// Whether the user has this role, or a higher one.
export function may(role) {
  return app.user && ROLES.indexOf(app.user.role) >= ROLES.indexOf(role);
}

/// Takes over a new status.
export function take(status) {
  const now = performance.now();
  app.status = status;
  app.heard = now;
  app.lost = false;
  const counts = new Map();
  const add = (key, count) => counts.set(key, (counts.get(key) || 0) + count);
  for (const unit of status.units) {
    add(`unit ${unit.port} ${unit.unit}`, unit.requests);
    add(`to ${unit.port}`, unit.requests);
  }
  for (const client of status.clients) add(`from ${client.port}`, client.requests);
  const polled = status.ports.find((port) => port.role === "scanner");
  for (const device of status.devices) if (polled) add(`from ${polled.port}`, device.requests);
  if (before) {
    const seconds = (now - before.now) / 1000;
    for (const [key, count] of counts) {
      const rate = Math.max(0, count - (before.counts.get(key) ?? count)) / Math.max(seconds, 0.2);
      // Smoothed over some seconds.
      app.rates.set(key, rate * 0.4 + (app.rates.get(key) || 0) * 0.6);
    }
    for (const key of app.rates.keys()) if (!counts.has(key)) app.rates.delete(key);
  }
  before = { now, counts };
  for (const point of status.points || []) {
    const past = app.history.get(point.name) || [];
    past.push(point.values[0]);
    app.history.set(point.name, past.slice(-HISTORY));
  }
  redraw();
}

/// A rate as text.
export function rate(key) {
  const value = app.rates.get(key) || 0;
  return value < 0.05 ? "" : value < 10 ? value.toFixed(1) : Math.round(value).toString();
}

export const isClient = (port) => / client$/.test(port.role);
export const isServer = (port) => /^(tcp|udp|rtu|ascii) server$/.test(port.role);
export const isOpen = (port) => port.status.startsWith("open") || port.status.startsWith("idle");
