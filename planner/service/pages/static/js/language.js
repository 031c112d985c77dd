// Texts in the language of the reader: English is the key, and what a catalogue lacks stays English.

export const LANGUAGES = { en: "English", de: "Deutsch", es: "Español", fr: "Français", ja: "日本語" };
const KEY = "headland-language";
const ATTRIBUTES = ["aria-label", "title", "alt", "placeholder"];
let messages = {}, language = "en";

export const languageInUse = () => language;

/** A text in the language in use. */
export const translate = (text) => messages[text] ?? text;

/** A text with values: t`${done} of ${all} plans` has the key "{0} of {1} plans". */
export function t(parts, ...values) {
  const key = parts.reduce((text, part, index) => `${text}{${index - 1}}${part}`);
  return translate(key).replace(/\{(\d+)\}/g, (_, index) => values[index]);
}

function chooseLanguage() {
  const wanted = [localStorage.getItem(KEY), ...navigator.languages].map((tag) => (tag ?? "").split("-")[0]);
  return wanted.find((code) => code in LANGUAGES) ?? "en";
}

function translateNode(root) {
  const walker = document.createTreeWalker(root, NodeFilter.SHOW_TEXT);
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
  document.documentElement.lang = language;
  translateNode(document.body);
}
