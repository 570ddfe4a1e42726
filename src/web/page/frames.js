// Frames of all ports as they come, decoded from the stream that Wireshark reads, too.

import { call } from "./api.js";
import { button, field, h, input, table } from "./dom.js";
import { app, redraw, tell } from "./state.js";
import { T } from "./texts.js";

const FRAMES_SHOWN = 200;
/// Bytes kept for the download.
const FRAMES_KEPT = 4_000_000;
/// The comments of frames in order.
const FINE = /^(requests|responses|foreign)$/;

let abort = null;
let seen = [];
let kept = [];
let keptBytes = 0;
/// No more are kept: a file with a hole would tell of frames that nobody sent.
let isFull = false;
let filter = "";

const hex = (bytes) => [...bytes].map((byte) => byte.toString(16).padStart(2, "0")).join(" ");

/// Blocks of a PCAPNG stream as it comes, little-endian.
class Blocks {
  rest = new Uint8Array();
  names = [];

  /// Takes the next bytes; returns the blocks that are whole now.
  feed(chunk, each) {
    const all = new Uint8Array(this.rest.length + chunk.length);
    all.set(this.rest);
    all.set(chunk, this.rest.length);
    let at = 0;
    while (at + 12 <= all.length) {
      const view = new DataView(all.buffer, at);
      const length = view.getUint32(4, true);
      if (length < 12 || at + length > all.length) break;
      const kind = view.getUint32(0, true);
      if (kind === 1) this.names.push(option(view, 16, length - 4, 2) || "");
      if (kind === 6) each(this.packet(view, length));
      at += length;
    }
    this.rest = all.slice(at);
    return all.subarray(0, at);
  }

  packet(view, length) {
    const micros = view.getUint32(12, true) * 4294967296 + view.getUint32(16, true);
    const size = view.getUint32(20, true);
    const end = 28 + size;
    let at = 28;
    let kind = "";
    while (at + 4 <= end) {
      const [tag, count] = [view.getUint16(at), view.getUint16(at + 2)];
      if (tag === 12) kind = bytesOf(view, at + 4, count).filter(Boolean).map((byte) => String.fromCharCode(byte)).join("");
      at += 4 + count;
      if (tag === 0) break;
    }
    const options = end + ((4 - (size % 4)) % 4);
    const flags = option(view, options, length - 4, 2, true) || 0;
    const comment = option(view, options, length - 4, 1);
    return {
      time: new Date(micros / 1000), port: this.names[view.getUint32(8, true)] || "", kind,
      sent: (flags & 3) === 2, fault: FINE.test(comment) ? null : comment, bytes: bytesOf(view, at, end - at),
    };
  }
}

const bytesOf = (view, at, count) => [...new Uint8Array(view.buffer, view.byteOffset + at, Math.max(0, count))];

function option(view, from, end, wanted, number) {
  for (let at = from; at + 4 <= end;) {
    const [code, count] = [view.getUint16(at, true), view.getUint16(at + 2, true)];
    if (code === 0) return null;
    if (code === wanted) return number ? view.getUint32(at + 4, true) : new TextDecoder().decode(new Uint8Array(bytesOf(view, at + 4, count)));
    at += 4 + count + ((4 - (count % 4)) % 4);
  }
  return null;
}

/// A frame in words: unit, function, and what follows.
function decoded({ kind, bytes, fault }) {
  if (fault) return fault;
  const pdu = kind === "mbrtu" ? bytes.slice(0, -2) : kind === "mbtcp" || kind === "mbudp" ? bytes.slice(6) : null;
  if (!pdu || pdu.length < 2) return String.fromCharCode(...bytes.filter((byte) => byte >= 32 && byte < 127));
  const [unit, code, ...rest] = pdu;
  if (code & 0x80) return `${T.unit} ${unit}: ${T.frames.exception} ${T.exceptions[rest[0]] || rest[0]}`;
  const two = rest.length >= 4 ? ` ${T.rules.address} ${rest[0] * 256 + rest[1]}, ${rest[2] * 256 + rest[3]}` : "";
  return `${T.unit} ${unit}: ${T.functions[code] || `${T.rules.function} ${code}`}${rest.length === 4 ? two : ""}`;
}

async function start() {
  abort = new AbortController();
  redraw();
  try {
    const blocks = new Blocks();
    const reader = (await call("GET", "frames", undefined, { signal: abort.signal })).body.getReader();
    for (;;) {
      const { value, done } = await reader.read();
      if (done) break;
      const whole = blocks.feed(value, (frame) => { seen = [frame, ...seen].slice(0, FRAMES_SHOWN); });
      if (!isFull && keptBytes + whole.length > FRAMES_KEPT) {
        isFull = true;
        tell(T.frames.full, "warn");
      }
      if (!isFull) {
        kept.push(whole);
        keptBytes += whole.length;
      }
      redraw();
    }
  } catch (error) {
    if (error.name !== "AbortError") tell(error.message, "bad");
  }
  abort = null;
  redraw();
}

function download() {
  const link = h("a", { href: URL.createObjectURL(new Blob(kept, { type: "application/x-pcapng" })), download: "mobgate.pcapng" });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

export const frames = {
  id: "frames",
  isOffered: () => app.status.frames,
  leave: () => abort?.abort(),
  draw: () => {
    const rows = seen.map((frame) => ({ frame, text: decoded(frame) }))
      .filter(({ frame, text }) => !filter || `${frame.port} ${text} ${hex(frame.bytes)}`.toLowerCase().includes(filter.toLowerCase()));
    return [h("h1", null, T.nav.frames), h("p", { class: "quiet" }, T.frames.intro),
      h("div", { class: "row" },
        abort ? button(T.frames.stop, () => abort.abort()) : button(T.frames.start, () => { [seen, kept, keptBytes, isFull] = [[], [], 0, false]; start(); }, { class: "main" }),
        button(T.frames.download, download, { disabled: !keptBytes }),
        field(T.frames.filter, input({ type: "search", value: filter, oninput: (event) => { filter = event.target.value; redraw(); }, placeholder: T.frames.filterHint }))),
      table(T.nav.frames, [T.log.time, T.port, T.frames.direction, T.frames.meaning, T.frames.bytes], rows.map(({ frame, text }) => ({
        props: { class: frame.fault ? "dead" : "" },
        cells: [frame.time.toISOString().slice(11, 23), frame.port, frame.sent ? T.frames.sent : T.frames.received, text, h("code", null, hex(frame.bytes))] })),
      abort ? T.frames.waiting : T.frames.none)];
  },
};
