// The candidate: lines that change it, how it differs, and how it comes into force.

import { attempt, call, get, post, text } from "./api.js";
import { ask, button, h } from "./dom.js";
import { app, may, redraw, tell } from "./state.js";
import { T } from "./texts.js";

/// Seconds within which a commit on trial must be confirmed.
const TRIAL = 300;

/// Bytes of lines that every board takes in one request.
const PIECE = 1500;
const bytes = new TextEncoder();

/// The lines in pieces, one for each request.
function inPieces(lines) {
  const pieces = [[]];
  let left = PIECE;
  for (const line of lines) {
    const length = bytes.encode(line).length + 1;
    if (length > left) {
      pieces.push([]);
      left = PIECE;
    }
    pieces.at(-1).push(line);
    left -= length;
  }
  return pieces;
}

/// Sends pieces to the candidate, or in place of it; the promise has the warnings. An error tells how many lines were taken.
async function sendPieces(pieces, replaces) {
  const warnings = [];
  let taken = 0;
  for (const piece of pieces) {
    try {
      const response = await call(replaces && !taken ? "PUT" : "POST", "settings/candidate", piece.join("\n"));
      warnings.push(...(await response.json()).warnings);
    } catch (error) {
      throw Object.assign(error, { taken });
    }
    taken += piece.length;
  }
  return warnings;
}

/// Sends all lines, or none: what there was before is there again.
async function sendLines(lines, replaces) {
  const pieces = inPieces(lines);
  const before = pieces.length > 1 ? await text("settings/candidate").catch(() => null) : null;
  try {
    return await sendPieces(pieces, replaces);
  } catch (error) {
    if (error.told?.line && lines.length > 1) error.message += ` (${T.line} ${error.taken + error.told.line})`;
    if (error.taken) await (before === null ? call("DELETE", "settings/candidate") : sendPieces(inPieces(before.split("\n")), true));
    throw error;
  }
}

/// Changes the candidate by lines, and tells about likely mistakes.
export async function change(lines, replaces) {
  return attempt(async () => {
    const warnings = await sendLines(lines, replaces);
    if (warnings.length) tell(warnings.map((warning) => warning.message).join("; "), "warn");
    else tell(T.candidate.changed);
    if (app.status && app.status.candidate === "none") app.status.candidate = "open";
    app.changed?.();
  });
}

/// Puts lines in force and saves them at once, where nobody has a candidate.
export async function applyAll(lines) {
  await sendLines(lines);
  try {
    await post("settings/commit", {});
  } catch (error) {
    await call("DELETE", "settings/candidate");
    throw error;
  }
}

async function review() {
  let diff;
  if (!(await attempt(async () => { diff = await get("settings/diff"); }))) return;
  const chosen = await ask(T.candidate.review, (done) => [
    diff.lines.length
      ? h("pre", { class: "diff", tabindex: 0, "aria-label": T.candidate.review }, diff.lines.map((line) =>
        h("span", { class: line.startsWith("+") ? "added" : "removed" }, `${line}\n`)))
      : h("p", null, T.candidate.same),
    h("p", { class: "quiet" }, diff.restarts.length ? `${T.candidate.restarts} ${diff.restarts.join(", ")}` : T.candidate.noRestarts),
    diff.rules.length > 0 && h("ul", { class: "fault" }, diff.rules.map(({ message }) => h("li", null, message))),
    h("p", { class: "actions" },
      button(T.candidate.trial, () => done({ confirmed: TRIAL }), { class: "main" }),
      button(T.candidate.commit, () => done({})),
      button(T.cancel, () => done())),
  ]);
  if (chosen) await settle(() => post("settings/commit", chosen), chosen.confirmed ? T.candidate.onTrial : T.candidate.saved)();
}

const settle = (work, text) => async () => {
  if (await attempt(work, text) && app.status) app.status.candidate = "none";
  app.changed?.();
  redraw();
};

/// The bar above all views, while there is a candidate or a commit on trial.
export function candidateBar() {
  const { candidate, remaining_s: left } = app.status;
  if (candidate === "none") return null;
  if (candidate === "waiting") {
    const time = `${Math.floor(left / 60)}:${String(left % 60).padStart(2, "0")}`;
    return h("section", { class: "bar warn", "aria-label": T.candidate.title },
      h("p", null, T.candidate.waiting, " ", h("strong", { role: "timer", class: "count" }, time)),
      may("engineer") && h("p", { class: "actions" },
        button(T.candidate.keep, settle(() => post("settings/confirm"), T.candidate.saved), { class: "main" }),
        button(T.candidate.back, settle(() => post("settings/rollback"), T.candidate.wentBack))));
  }
  return h("section", { class: "bar", "aria-label": T.candidate.title },
    h("p", null, T.candidate.open),
    may("engineer") && h("p", { class: "actions" },
      button(T.candidate.reviewButton, review, { class: "main" }),
      button(T.candidate.discard, settle(() => call("DELETE", "settings/candidate"), T.candidate.discarded))));
}
