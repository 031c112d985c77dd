// All elements are made here. Data becomes text or a property, never markup. Texts appear in the language of the reader.
import { translate } from "./language.js";

const PROPERTIES = new Set(["value", "checked", "disabled", "hidden", "selected", "indeterminate", "max", "srcdoc"]);
const WORDS = new Set(["aria-label", "title", "alt", "placeholder"]);
const inLanguage = (child) => (typeof child === "string" ? translate(child) : child);

/** An element: `attributes` may hold handlers (onclick), `style` (custom properties), `class`, and properties. */
export function el(name, attributes = {}, ...children) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === null || value === undefined) continue;
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (key === "style") for (const [name, of] of Object.entries(value)) node.style.setProperty(name, of);
    else if (PROPERTIES.has(key)) node[key] = value;
    else if (value === true) node.setAttribute(key, "");
    else if (value !== false) node.setAttribute(key, WORDS.has(key) ? translate(String(value)) : String(value));
  }
  fill(node, children);
  return node;
}

const SVG = "http://www.w3.org/2000/svg";

/** A drawn sign of a path in a box of 24. */
export function icon(path) {
  const [picture, stroke] = ["svg", "path"].map((name) => document.createElementNS(SVG, name));
  picture.setAttribute("viewBox", "0 0 24 24");
  picture.setAttribute("aria-hidden", "true");
  picture.setAttribute("class", "icon");
  stroke.setAttribute("d", path);
  picture.append(stroke);
  return picture;
}

/** Add children: nodes, texts, lists of them; null and false are left out. */
export function fill(node, ...children) {
  node.append(...children.flat(Infinity).filter((one) => one !== null && one !== undefined && one !== false).map(inLanguage));
  return node;
}

/** Put children in the place of what is there. */
export function put(node, ...children) {
  node.replaceChildren();
  return fill(node, ...children);
}

/** Set a text only where it changed, so that screen readers and selections are not disturbed. */
export function say(node, words) {
  const text = translate(words);
  if (node.textContent !== text) node.textContent = text;
}

export const button = (words, onclick, look = "", more = {}) =>
  el("button", { type: "button", class: look || null, onclick, ...more }, words);

/** A labelled control: its name above it and a hint below. */
export function labelled(name, control, hint = "") {
  return el("label", {}, el("span", { class: "name" }, name), control, hint && el("span", { class: "hint" }, hint));
}

export const option = (value, words = value, selected = false) => el("option", { value, selected }, words);

/** A highlighted sentence; an error is read aloud at once. */
export function note(sentence, look = "", ...more) {
  return el("div", { class: `note ${look}`, role: look === "error" ? "alert" : null }, el("p", {}, sentence), ...more);
}

/** A refusal; with a link to enter a token where one is missing. */
export function sorry(error) {
  return note(error.message, "error", (error.status === 401 || error.status === 403) && tokenLink());
}

const tokenLink = () => el("a", { class: "button small", href: "#/access" }, "Enter a token");

/** Shown above a form that cannot be sent without a token. */
export const lookingOnly = () => note("You can look at everything here. To add, plan or change something, enter a token, or open the address that headland serve printed last.", "warn", tokenLink());

/** Announce a text to screen readers. */
export const speak = (words) => say(document.getElementById("spoken"), words);

export const heading = (title, below = "", ...actions) =>
  el("div", { class: "head" },
    el("div", {}, el("h1", { tabindex: "-1" }, title), below && el("p", { class: "soft" }, below)),
    actions.length ? el("div", { class: "row" }, actions) : null);

/** The number of a tractor in its colour; from 1. */
export const who = (number) =>
  el("span", { class: "who", style: { "--colour": `var(--t${(number - 1) % 7})` }, "aria-hidden": "true" }, String(number));

/** Facts as label and value. */
export const facts = (pairs) =>
  el("dl", { class: "facts" }, pairs.map(([name, value]) => el("div", {}, el("dt", {}, name), el("dd", {}, value))));
