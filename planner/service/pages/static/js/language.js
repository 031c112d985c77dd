// Texts in the language of the reader: English is the key, and what a catalogue lacks stays English.

export const LANGUAGES = { en: "English", de: "Deutsch", es: "Español", fr: "Français", ja: "日本語" };
const KEY = "headland-language";
const ATTRIBUTES = ["aria-label", "title", "alt", "placeholder"];
const PLACE = /\{(\w+)\}/;
const LEAST_LETTERS = 6, MOST_REMEMBERED = 4000, MOST_CHARS = 2000;
const TYPED = new Set(["argument", "command", "file", "name", "option", "options", "other", "path"]);
let messages = {}, patterns = [], language = "en";
const remembered = new Map();

export const languageInUse = () => language;

/** A text in the language in use; a finished sentence of the service is found by the key that it was made from. */
export function translate(text) {
  if (language === "en" || typeof text !== "string") return text;
  const exact = messages[text];
  if (exact !== undefined) return exact;
  if (!text.includes(" ") || text.startsWith("\n") || text.length > MOST_CHARS) return text;
  if (!remembered.has(text)) {
    if (remembered.size >= MOST_REMEMBERED) remembered.clear();
    remembered.set(text, byPattern(text));
  }
  return remembered.get(text);
}

/** A text of several sentences, each by itself. */
export const translateAll = (text) => text.split(/(?<=\.) (?=[A-Z0-9])/).map(translate).join(" ");

function byPattern(text) {
  for (const { begin, end, pattern, names, to } of patterns) {
    if (!text.startsWith(begin) || !text.endsWith(end)) continue;
    const values = pattern.exec(text)?.slice(1);
    if (values) return fillIn(to, Object.fromEntries(values.map((value, k) => [names[k], TYPED.has(names[k]) ? value : translateQuoted(value)])));
  }
  const needs = text.endsWith(".") ? byPattern(text.slice(0, -1)) : ""; // a sentence whose key is its part before the full stop
  return needs && needs !== text.slice(0, -1) ? fillIn(messages["{needs}."] ?? "{needs}.", { needs }) : text;
}

// A label in quotes is translated within them.
const translateQuoted = (value) => { const label = /^\u201c(.*)\u201d$/.exec(value)?.[1]; return label ? `\u201c${translate(label)}\u201d` : translateListed(value); };
// A text, or texts with commas between them and the last after "or"; what somebody typed is in quotes and stays.
const translateListed = (value) => {
  const whole = translate(value), [, first, last] = (whole === value && /^([^'"]+) or ([^'"]+)$/s.exec(value)) || [];
  return last ? fillIn(messages["{items} or {last}"] ?? "{items} or {last}", { items: first.split(", ").map(translate).join(", "), last: translate(last) }) : whole;
};
const fillIn = (text, values) => text.replace(/\{(\w+)\}/g, (found, name) => values[name] ?? found);
const escaped = (text) => text.replace(/[.*+?^${}()|[\]\\]/g, "\\$&");

/** Keys with values as patterns, those with most text first. */
function listPatterns() {
  const found = [];
  for (const [key, to] of Object.entries(messages)) {
    const parts = key.split(PLACE), letters = parts.filter((_, k) => k % 2 === 0).join("").replace(/[^A-Za-z]/g, "").length;
    if (parts.length === 1 || letters < LEAST_LETTERS) continue;
    const source = parts.map((part, k) => (k % 2 ? "(.*?)" : escaped(part))).join("");
    found.push({ letters, begin: parts[0], end: parts.at(-1), pattern: new RegExp(`^${source}$`, "s"), names: parts.filter((_, k) => k % 2), to });
  }
  return found.sort((one, other) => other.letters - one.letters);
}

/** A text with values: t`${done} of ${all} plans` has the key "{0} of {1} plans". */
export function t(parts, ...values) {
  const key = parts.reduce((text, part, index) => `${text}{${index - 1}}${part}`);
  return fillIn(messages[key] ?? key, values.map(String));
}

/** A count with its noun: plural(2, "plan") has the key "{0} plans". */
export const plural = (count, one, many = `${one}s`) => {
  const key = `{0} ${count === 1 ? one : many}`;
  return fillIn(messages[key] ?? key, [String(count)]);
};

/** Words with commas, the last after "and". */
export const listed = (words) => (words.length > 1 ? t`${words.slice(0, -1).join(", ")} and ${words.at(-1)}` : words.join(""));

function chooseLanguage() {
  const wanted = [localStorage.getItem(KEY), ...navigator.languages].map((tag) => (tag ?? "").split("-")[0]);
  return wanted.find((code) => code in LANGUAGES) ?? "en";
}

function translateNode(root) {
  const accept = (node) => (node.parentElement.closest('[translate="no"]') ? NodeFilter.FILTER_REJECT : NodeFilter.FILTER_ACCEPT);
  const walker = document.createTreeWalker(root, NodeFilter.SHOW_TEXT, accept);
  while (walker.nextNode()) walker.currentNode.textContent = translate(walker.currentNode.textContent);
  for (const name of ATTRIBUTES) for (const node of root.querySelectorAll(`[${name}]`)) node.setAttribute(name, translate(node.getAttribute(name)));
}

/** Load the catalogue before the first page is shown; the list of languages in the bar changes it. */
export async function startLanguage(picker) {
  language = chooseLanguage();
  for (const [code, name] of Object.entries(LANGUAGES)) picker.append(new Option(name, code, false, code === language));
  picker.addEventListener("change", () => {
    localStorage.setItem(KEY, picker.value);
    location.reload();
  });
  if (language === "en") return;
  try {
    const answer = await fetch(`static/languages/${language}.json`);
    if (answer.ok) messages = await answer.json();
  } catch { /* Without its catalogue the page is English. */ }
  patterns = listPatterns();
  document.documentElement.lang = language;
  translateNode(document.body);
}
