// What is wrong, in words, with the remedy that docs/troubleshooting.md has for it.

import { app, isOpen } from "./state.js";
import { T } from "./texts.js";

/// Errors of the line, which corrupt what devices send.
const CORRUPTION = ["bad-crc", "short", "framing", "parity", "noise", "corrupt"];
/// Share of requests with such errors from which a unit counts as corrupt.
const CORRUPT = 0.01;

/// The errors of a unit by kind: `3 silent, 2 bad-crc; advice`.
export function lineErrors(unit) {
  return unit.errors.split(/[;,] */).map((part) => /^(\d+) ([a-z-]+)$/.exec(part)).filter(Boolean)
    .map(([, count, kind]) => ({ kind, count: Number(count) }));
}

/// The lamp of a unit.
export function health(unit) {
  const corrupt = lineErrors(unit).filter(({ kind }) => CORRUPTION.includes(kind)).reduce((sum, { count }) => sum + count, 0);
  if (unit.state === "down") return "down";
  if (corrupt > unit.requests * CORRUPT) return "corrupt";
  if (unit.state === "out-of-step" || /slower/.test(unit.errors)) return "slow";
  return unit.state === "held" ? "idle" : "up";
}

export const healthText = (state) => T.lamps[state];

/// All that is wrong, the worst first.
export function problems() {
  const { ports, units, rules, unsaved } = app.status;
  const found = [];
  const add = (level, title, fix) => found.push({ level, title, fix });
  for (const port of ports) {
    if (isOpen(port) || port.status === "off") continue;
    const known = T.portFixes.find(([pattern]) => pattern.test(port.status));
    add(port.status.startsWith("lost") ? 1 : 2, T.portFails(port.port, port.status), known ? known[1] : T.portFix);
  }
  for (const unit of units) {
    const state = health(unit);
    if (state === "up" || state === "idle") continue;
    const worst = lineErrors(unit).sort((one, other) => other.count - one.count)[0];
    const fix = state === "slow" ? T.fixes.late : T.fixes[worst?.kind] || T.fixes.silent;
    add(state === "down" ? 2 : 1, T.unitFails[state](unit.unit, unit.port), fix);
  }
  for (const rule of rules) {
    const warning = rule.policy.split("  # ")[1];
    if (warning) add(0, warning, T.ruleFix);
  }
  if (unsaved) add(0, T.unsaved, T.unsavedFix);
  return found.sort((one, other) => other.level - one.level);
}
