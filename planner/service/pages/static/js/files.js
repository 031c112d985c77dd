// Choosing one of the files the service has, or adding one to them.
import { el, put, labelled, option, note } from "./dom.js";
import { items, upload, get, part } from "./api.js";

/** A select of the files of a kind with an upload beside it; `changed(name)` after every choice. */
export async function filePicker(kind, title, { accept = "", changed = () => {}, none = null, first = null, hint = "" } = {}) {
  const select = el("select", { name: kind, onchange: () => changed(select.value) }), trouble = el("div");
  const file = el("input", { type: "file", accept, "aria-label": `Add a file: ${title}` });
  const list = async (wanted = select.value || first) => {
    const all = await items(kind);
    put(select, none !== null && option("", none), all.map((one) => option(one.name, one.sample ? `${one.name} (sample)` : one.name, one.name === wanted)));
    changed(select.value);
  };
  file.addEventListener("change", async () => {
    if (!file.files.length) return;
    put(trouble);
    try {
      const made = await upload(kind, file.files[0]);
      await list(made.name);
    } catch (error) {
      put(trouble, note(error.message, "error"));
    }
    file.value = "";
  });
  await list(first);
  const node = el("div", { class: "stack" }, labelled(title, select, hint), labelled("Add a file", file), trouble);
  return { node, select, list, value: () => select.value || null };
}

/** The field that a name means, with its rings in metres: {field, error, fields} as the reader has it. */
export const fieldSummary = (name, local = false) => get(`fields/${part(name)}/summary${local ? "?local=true" : ""}`);
