// Elements, and how a tree of them becomes the one that is shown without losing focus or what was typed.

const SVG = "http://www.w3.org/2000/svg";

/// An element of HTML. Properties that begin with `on` are listeners; `true` and `false` set and clear an attribute.
export function h(tag, props, ...children) {
  return fill(document.createElement(tag), props, children);
}

/// An element of SVG.
export function v(tag, props, ...children) {
  return fill(document.createElementNS(SVG, tag), props, children);
}

function fill(element, props, children) {
  element.$on = {};
  for (const [name, value] of Object.entries(props || {})) {
    if (name.startsWith("on")) listen(element, name.slice(2), value);
    else if (name === "value" && isTyped(element, props)) element.$value = value;
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== undefined && value !== null) element.setAttribute(name, value);
  }
  element.append(...children.flat(9).filter((child) => child !== null && child !== undefined && child !== false));
  if (element.$value !== undefined) element.value = element.$value;
  return element;
}

/// Whether its value is what a user types or chooses.
function isTyped({ tagName }, { type }) {
  return tagName === "SELECT" || tagName === "TEXTAREA" || (tagName === "INPUT" && type !== "checkbox");
}

function listen(element, kind, listener) {
  if (!listener) return;
  if (!element.$on[kind]) element.addEventListener(kind, (event) => element.$on[kind]?.(event));
  element.$on[kind] = listener;
}

/// Makes the children of `parent` like `nodes`; elements that stay keep their focus, and fields what was typed.
export function morph(parent, nodes) {
  nodes.forEach((node, at) => {
    const old = parent.childNodes[at];
    if (!old) parent.append(node);
    else if (old.nodeName !== node.nodeName || key(old) !== key(node)) old.replaceWith(node);
    else if (node.nodeType === Node.TEXT_NODE) {
      if (old.data !== node.data) old.data = node.data;
    } else update(old, node);
  });
  while (parent.childNodes.length > nodes.length) parent.lastChild.remove();
}

function key(node) {
  return node.getAttribute?.("data-key");
}

function update(old, node) {
  for (const { name } of [...old.attributes]) if (!node.hasAttribute(name) && name !== "open") old.removeAttribute(name);
  for (const { name, value } of node.attributes) if (old.getAttribute(name) !== value) old.setAttribute(name, value);
  const known = old.$on || (old.$on = {});
  for (const kind of Object.keys(known)) known[kind] = node.$on?.[kind];
  for (const [kind, listener] of Object.entries(node.$on || {})) {
    if (kind in known) known[kind] = listener;
    else listen(old, kind, listener);
  }
  morph(old, [...node.childNodes]);
}

/// A table in a region that scrolls by itself where the screen is narrow. Cells are texts or nodes.
export function table(label, heads, rows, empty) {
  if (!rows.length) return h("p", { class: "empty" }, empty);
  return h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": label },
    h("table", null,
      h("thead", null, h("tr", null, heads.map((head) =>
        h("th", { scope: "col", class: head.right && "right" }, head.text ?? head)))),
      h("tbody", null, rows.map((row) => h("tr", row.props, row.cells.map((cell, at) =>
        h("td", { class: heads[at]?.right && "right" }, cell)))))));
}

/// A field with its label.
export function field(label, control, hint) {
  return h("label", { class: "field" }, h("span", null, label), control, hint && h("small", null, hint));
}

export function input(props) {
  return h("input", { type: "text", autocomplete: "off", spellcheck: "false", ...props });
}

export function select(props, options) {
  return h("select", props, options.map((option) => {
    const [value, text] = Array.isArray(option) ? option : [option, option];
    return h("option", { value, selected: value === props.value }, text);
  }));
}

export function button(text, onclick, props) {
  return h("button", { type: "button", onclick, ...props }, text);
}

/// A lamp: its shape tells the state, not only its colour.
export function lamp(state, text) {
  return h("span", { class: `lamp ${state}` }, h("span", { "aria-hidden": "true" }, MARKS[state]), text);
}

export const MARKS = { up: "✓", slow: "…", corrupt: "!", down: "✕", idle: "–" };

/// Asks in a dialog; the promise has what `content(done)` gives to `done`, or nothing if it is left.
export function ask(title, content) {
  return new Promise((resolve) => {
    const done = (value) => {
      dialog.close();
      dialog.remove();
      resolve(value);
    };
    const dialog = h("dialog", { "aria-labelledby": "dialog-title", oncancel: () => done() });
    dialog.append(h("h2", { id: "dialog-title" }, title), ...content(done).filter(Boolean));
    document.body.append(dialog);
    dialog.showModal();
  });
}

/// Asks whether to go on.
export function confirmed(title, text, yes, no) {
  return ask(title, (done) => [
    h("p", null, text),
    h("p", { class: "actions" }, button(yes, () => done(true), { class: "main" }), button(no, () => done(false))),
  ]);
}
