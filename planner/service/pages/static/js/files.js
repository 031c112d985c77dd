// Choosing one of the files the service has, or adding one to them.
import { el, put, button, labelled, option, sorry } from "./dom.js";
import { items, upload, get, part } from "./api.js";

/** A select of the files of a kind with an upload beside it; `changed(name)` after every choice. */
export async function filePicker(kind, title, { accept = "", changed = () => {}, none = null, first = null, hint = "" } = {}) {
  const select = el("select", { name: kind, onchange: () => { put(trouble); changed(select.value); } }), trouble = el("div", { class: "stack" });
  const file = el("input", { type: "file", accept, "aria-label": `Add a file: ${title}` });
  let all = [];
  const list = async (wanted = select.value || first) => {
    all = await items(kind);
    put(select, none !== null && option("", none), all.map((one) => option(one.name, one.sample ? `${one.name} (sample)` : one.name, one.name === wanted)));
    changed(select.value);
  };
  const add = async (one, said = {}) => {
    put(trouble, el("p", { class: "small soft", role: "status" }, `Adding ${one.name}\u2026`));
    try {
      const made = await upload(kind, one, said);
      await list(made.name);
      put(trouble);
    } catch (error) {
      put(trouble, sorry(error), (HOW.has(error.parameter) || said.crs) && howToRead(said, (more) => add(one, more)));
    }
  };
  file.addEventListener("change", async () => {
    if (file.files.length) await add(file.files[0]);
    file.value = "";
  });
  await list(first);
  const node = el("div", { class: "stack" }, labelled(title, select, hint), labelled("Add a file", file), trouble);
  return { node, select, list, value: () => select.value || null, options: () => all.find((one) => one.name === select.value)?.options ?? {} };
}

// Questions about a file that lacks its coordinate system or axis order.
const HOW = new Set(["crs", "swap_axes", "local"]);

function howToRead(said, again) {
  const crs = el("input", { name: "upload-crs", value: said.crs ?? "", placeholder: "EPSG:25832", spellcheck: "false" });
  const [swap, local] = ["swap_axes", "local"].map((name) => el("input", { type: "checkbox", checked: Boolean(said[name]) }));
  return el("div", { class: "panel stack" }, labelled("Its coordinate system", crs, "Ask whoever made the file; EPSG:4326 is longitude and latitude."),
    el("label", { class: "check" }, swap, "Latitude or northing comes first"), el("label", { class: "check" }, local, "Local metres"),
    el("div", {}, button("Add with these settings", () => again({ crs: crs.value.trim(), swap_axes: swap.checked, local: local.checked }), "main small")));
}

/** The field of a name, with its rings in metres: {field, error, fields} as the reader has it.

`how` says which of several (key) and how the file is read (local, swap_axes, crs); what is left out is as it was uploaded. */
export function fieldSummary(name, how = {}) {
  const given = Object.entries(how).filter(([, value]) => value !== null && value !== undefined && value !== "");
  return get(`fields/${part(name)}/summary${given.length ? `?${new URLSearchParams(given)}` : ""}`);
}
