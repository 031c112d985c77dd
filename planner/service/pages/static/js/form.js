// A TOML file as a form: the text and the controls are two views of it, and each fault is told at its control.
import { el, put, say, button, labelled, note, option, speak } from "./dom.js";
import { post } from "./api.js";
import { t, translate } from "./language.js";

const TYPED_MS = 400, SETTLE_MS = 20;
const nameOf = (path) => path.join(".");
const at = (values, path) => path.reduce((value, key) => value?.[key], values);

/** The value of a typed text: a number where it is one, with a decimal comma too; null for nothing. */
export function numberOf(text) {
  const plain = text.trim().replace(",", ".");
  return !plain ? null : Number.isFinite(Number(plain)) ? Number(plain) : text.trim();
}
export const listOf = (text, mark = ",") => { const parts = text.split(mark).map((one) => one.trim()).filter(Boolean); return parts.length ? parts : null; };

/** A form of a layout: {values, more, lists, sections}, each value [key, title, {number, list, check, choices, hint}].

`choices(name, form)` gives what a select offers; `changed(text)` is told of every new text. */
export function tomlForm(kind, layout, { choices = () => [], changed = () => {} } = {}) {
  let form = { text: "", values: {}, faults: [], choices: {} }, waiting = [], busy = false, shape = "", timer = 0, closed = false;
  const controls = new Map(), top = el("div", { class: "stack" }), body = el("div", { class: "stack" });
  const text = el("textarea", { rows: "16", spellcheck: "false", class: "code", name: `${kind}-text` }), asText = el("details", {}, el("summary", {}, "As text"), labelled("The same in TOML, with comments", text, "The form above follows this text, and this text follows the form."));
  const node = el("div", { class: "stack" }, top, body, asText);

  // Changes are sent one after the other; those that come meanwhile go together.
  const send = async (focus = null) => {
    if (busy || closed) return;
    busy = true;
    while (waiting.length && !closed) {
      const now = waiting, sent = now.some((one) => one.text !== undefined) ? now.findLast((one) => one.text !== undefined).text : form.text;
      waiting = [];
      try {
        const answer = await post(`forms/${kind}`, { text: sent, changes: now.filter((one) => one.path) });
        show(answer, !now.some((one) => one.text !== undefined && one.typed));
        put(top, told());
      } catch (error) { put(top, note(error.message, "error")); }
    }
    busy = false;
    if (focus) node.querySelector(focus)?.focus();
  };
  const change = (path, value, focus = null) => { waiting.push({ path, value }); return send(focus); };
  const show = (answer, writes) => {
    form = answer;
    if (writes || document.activeElement !== text) text.value = form.text;
    changed(form.text);
    const now = JSON.stringify([shapeOf(form.values), form.choices]);
    if (now !== shape) { shape = now; build(); }
    for (const one of controls.values()) one.tell();
    mark();
  };
  const shapeOf = (values) => layout.lists.map(({ key }) => (Array.isArray(values[key]) ? values[key].length : 0));

  // Faults that belong to no control are told at the top.
  const homeOf = (path) => { for (let n = path.length; n; n -= 1) if (controls.has(nameOf(path.slice(0, n)))) return controls.get(nameOf(path.slice(0, n))); return null; };
  const told = () => form.faults.filter(({ path }) => !homeOf(path)).map(({ path, sentence }) => note(path.length ? `${nameOf(path)}: ${sentence}` : sentence, "error"));
  const mark = () => {
    const wrong = new Map();
    for (const { path, sentence } of form.faults) { const home = homeOf(path); if (home) wrong.set(home, [...(wrong.get(home) ?? []), home.missing && path.length === 1 ? home.missing : sentence]); }
    for (const one of controls.values()) one.blame(wrong.get(one)?.join(" ") ?? "");
    asText.classList.toggle("wrong", form.faults.some(({ path }) => !path.length));
  };

  const control = (path, title, { number = false, list = false, check = false, of = null, pair = null, hint = "" } = {}) => {
    const name = nameOf(path), fault = el("span", { class: "fault", id: `fault-${kind}-${name}` });
    const offered = of ? () => [...new Set([...(Array.isArray(of) ? of : choices(of, form)), at(form.values, path)].filter((one) => typeof one === "string" && one))] : null;
    const write = () => change(path, check ? (input.checked ? true : null) : number ? numberOf(input.value) : list ? listOf(input.value, list === true ? "," : list) : input.value.trim() || null);
    const input = offered ? el("select", { name, onchange: write }, option("", hint || "not given"), offered().map((one) => option(one)))
      : check ? el("input", { type: "checkbox", name, onchange: write }) : el("input", { name, onchange: write, inputmode: number ? "decimal" : null, spellcheck: "false" });
    const tell = () => {
      const value = at(form.values, path);
      if (check) input.checked = value === true;
      else if (document.activeElement !== input || offered) input.value = value === undefined || value === null ? "" : list && Array.isArray(value) ? value.join(list === true ? ", " : `${list} `) : String(value);
    };
    const blame = (sentence) => {
      say(fault, sentence);
      if (sentence) { input.setAttribute("aria-invalid", "true"); input.setAttribute("aria-describedby", fault.id); input.closest("details")?.setAttribute("open", ""); }
      else { input.removeAttribute("aria-invalid"); input.removeAttribute("aria-describedby"); }
    };
    controls.set(name, { tell, blame });
    return check ? el("div", {}, el("label", { class: "check" }, input, title), fault) : el("div", {}, labelled(title, input, offered ? "" : hint), fault);
  };
  const valuesOf = (home, rows) => rows.map(([key, title, more]) => (more?.pair ? pairOf([...home, key], more) : control([...home, ...key.split(".")], title, more)));
  const pairOf = (path, { pair, of }) => {
    const fault = el("span", { class: "fault" }), offered = [...new Set([...choices(of, form), ...(at(form.values, path) ?? [])])].filter((one) => typeof one === "string");
    const write = () => change(path, selects.map((one) => one.value));
    const selects = pair.map((title, k) => el("select", { name: `${nameOf(path)}.${k}`, onchange: write }, option("", "choose one"), offered.map((one) => option(one))));
    controls.set(nameOf(path), { tell: () => selects.forEach((one, k) => { one.value = at(form.values, [...path, k]) ?? ""; }), blame: (sentence) => { say(fault, sentence); selects.forEach((one) => (sentence ? one.setAttribute("aria-invalid", "true") : one.removeAttribute("aria-invalid"))); } });
    return [labelled(pair[0], selects[0]), el("div", {}, labelled(pair[1], selects[1]), fault)];
  };
  const grid = (home, { values = [], more = [], moreTitle = "More" }) => [el("div", { class: "grid" }, valuesOf(home, values)),
    more.length ? el("details", {}, el("summary", {}, moreTitle), el("div", { class: "grid" }, valuesOf(home, more))) : null];
  const entry = (part, k) => {
    const remove = () => change([part.key, k], null, `[data-add="${part.key}"]`).then(() => speak("Removed."));
    const called = at(form.values, [part.key, k, "name"]) ?? "";
    return el("fieldset", { class: "panel stack" }, el("legend", { class: "small" }, `${translate(part.one)} ${k + 1}${called ? `: ${called}` : ""}`), grid([part.key, k], part),
      el("div", {}, button(part.remove, remove, "small", { "aria-label": `${translate(part.remove)}: ${called || k + 1}` })));
  };
  const list = (part) => {
    const size = Array.isArray(form.values[part.key]) ? form.values[part.key].length : 0, fault = el("p", { class: "fault" });
    controls.set(part.key, { tell: () => {}, blame: (sentence) => say(fault, sentence), missing: part.missing });
    const add = () => change([part.key, size], part.begin(form), `[name="${part.key}.${size}.${part.values[0][1] ? part.values[0][0] : "between.0"}"]`);
    return el("section", { class: "stack" }, el("h3", {}, part.title), part.hint && el("p", { class: "small soft" }, part.hint), fault, Array.from({ length: size }, (_, k) => entry(part, k)),
      el("div", {}, button(part.add, add, "small", { "data-add": part.key })));
  };
  const build = () => {
    const kept = document.activeElement?.name, folded = [...body.querySelectorAll("details")].map((one) => one.open);
    controls.clear();
    put(body, grid([], layout), layout.lists.map(list), (layout.sections ?? []).map((part) => el("section", { class: "stack" }, el("h3", {}, part.title), grid([part.key], part))));
    [...body.querySelectorAll("details")].forEach((one, k) => { one.open = Boolean(folded[k]) && folded.length === body.querySelectorAll("details").length; });
    if (kept && body.querySelector(`[name="${CSS.escape(kept)}"]`)) body.querySelector(`[name="${CSS.escape(kept)}"]`).focus();
  };
  text.addEventListener("input", () => {
    changed(text.value);
    clearTimeout(timer);
    timer = setTimeout(() => { waiting.push({ text: text.value, typed: true }); send(); }, TYPED_MS);
  });
  return {
    node, text: () => text.value, faults: () => form.faults,
    set: (value) => { waiting.push({ text: value }); return send(); },
    settled: async () => { while (busy || waiting.length) await new Promise((done) => setTimeout(done, SETTLE_MS)); },
    focusFault: () => (node.querySelector("[aria-invalid]") ?? top).scrollIntoView({ block: "center" }) ?? node.querySelector("[aria-invalid]")?.focus(),
    close: () => { closed = true; clearTimeout(timer); },
  };
}
