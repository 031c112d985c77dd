// What can be done with one thing of the library: rename, copy, replace, save, delete.
import { ACCEPTED } from "./accepted.js"; // made by the service: the endings that it takes
import { el, put, button, labelled, sorry, speak } from "./dom.js";
import { patch, post, remove, saveNamed, part } from "./api.js";
import { addFile } from "./files.js";
import { t, translate } from "./language.js";

/** Files have names, jobs have identities. */
export const keyOf = (kind, one) => (kind in ACCEPTED ? one.name : one.id);

/** Whether somebody may change a thing: what belongs to nobody, what is his, or everything for an administrator. */
export const mayChange = (one, me) =>
  !one.sample && Boolean(me?.rights.includes("plan")) && (!one.owner || (me.identity && one.owner_identity === me.identity) || me.rights.includes("administer"));

/** Buttons for one thing; `changed(key, words)` after each change, with the key of what is there now, or null. */
export function changeActions(kind, one, me, changed) {
  const path = `${kind}/${part(keyOf(kind, one))}`, isFile = kind in ACCEPTED, place = el("div", { class: "stack" });
  const locked = !mayChange(one, me), done = (key, words) => { put(place); speak(words); return changed(key, words); };
  const attempt = async (work) => { try { await work(); } catch (error) { put(place, sorry(error)); } };
  const ask = (...children) => { put(place, el("div", { class: "panel stack" }, children)); place.querySelector("input, button")?.focus(); };
  const keep = button("Cancel", () => { put(place); }, "small");
  const rename = () => {
    const name = el("input", { value: one.name, maxlength: "100", name: "new-name" });
    const form = el("form", { class: "row" }, el("div", { class: "grow" }, labelled("New name", name)), el("button", { class: "main small" }, "Rename"), keep);
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      attempt(async () => { const made = await patch(path, { name: name.value.trim() }); await done(keyOf(kind, made), t`Renamed to ${made.name}.`); });
    });
    ask(form);
    name.select();
  };
  const copy = () => attempt(async () => { const made = await post(`${path}/copy`); await done(keyOf(kind, made), t`Copied as ${made.name}.`); });
  const erase = () => ask(el("p", {}, isFile ? t`Delete ${one.name}? Plans made from it keep what they were made of.` : t`Delete ${one.name} and its results?`),
    el("div", { class: "row" }, button("Delete", () => attempt(async () => { await remove(path); await done(null, t`${one.name} is deleted.`); }), "danger small"), keep));
  const replace = () => {
    const file = el("input", { type: "file", accept: ACCEPTED[kind] }), said = { ...one.options, name: one.name, replace: true }, under = el("div", { class: "stack" });
    file.addEventListener("change", () => { if (file.files.length) addFile(kind, file.files[0], under, (made) => done(keyOf(kind, made), t`${made.name} is replaced.`), said); });
    ask(labelled("The corrected file", file, "Plans made from the older file keep it."), under, el("div", {}, keep));
  };
  const act = (words, work, look = "", off = locked) => button(words, work, `small ${look}`, { disabled: off, "aria-label": `${translate(words)}: ${one.name}` });
  const node = el("div", { class: "stack" }, el("div", { class: "row" },
    act("Rename", rename), act("Copy", copy, "", !me?.rights.includes("plan") || ["queued", "running"].includes(one.status)),
    isFile && act("Replace", replace), isFile && act("Save to disk", () => attempt(() => saveNamed(path)), "", false), act("Delete", erase, "danger")), place);
  return node;
}

/** Why the buttons are off, in a sentence; "" where they are on. */
export function whyLocked(one, me) {
  if (mayChange(one, me)) return "";
  if (one.sample) return "This comes with Headland: copy it to change it.";
  return me?.rights.includes("plan") ? t`This belongs to ${one.owner}; only that token or an administrator’s changes it.` : "Changing needs a planner’s token.";
}
