// Choosing one of the files the service has, or adding one to them.
import { el, put, button, labelled, option, sorry } from "./dom.js";
import { t, translate } from "./language.js";
import { items, upload, get, part } from "./api.js";

const CHOSEN = "headland-chosen-";
export const SAMPLE_TRACTOR = "eg105";

/** The file of a kind that was added or picked last in this tab; it is chosen wherever that kind is asked for. */
export const lastChosen = (kind) => sessionStorage.getItem(CHOSEN + kind);
export const rememberChoice = (kind, name) => sessionStorage.setItem(CHOSEN + kind, name);

/** A select of the files of a kind with an upload beside it; `changed(name)` after every choice. */
export async function filePicker(kind, title, { name = kind, accept = "", changed = () => {}, none = null, first = null, chosen = null, hint = "" } = {}) {
  const select = el("select", { name, onchange: () => { put(trouble); changed(select.value); } }), trouble = el("div", { class: "stack" });
  const file = el("input", { type: "file", accept, "aria-label": t`Add a file: ${translate(title)}` });
  let all = [];
  const list = async (wanted = select.value || first) => {
    all = await items(kind);
    if (wanted && !all.some((one) => one.name === wanted)) wanted = first;
    put(select, none !== null && option("", none), all.map((one) => option(one.name, one.sample ? t`${one.name} (sample)` : one.name, one.name === wanted)));
    changed(select.value);
  };
  file.addEventListener("change", async () => {
    if (file.files.length) await addFile(kind, file.files[0], trouble, (made) => list(made.name));
    file.value = "";
  });
  await list(chosen ?? ((!["tables", "elevations"].includes(kind) && lastChosen(kind)) || first));
  const change = el("a", { class: "small", href: `#/library/${kind}` }, "Rename, replace, copy or delete in the library");
  const node = el("div", { class: "stack" }, labelled(title, select, hint), labelled("Add a file", file), trouble, el("p", {}, change));
  return { node, select, list, value: () => select.value || null, sample: () => Boolean(all.find((one) => one.name === select.value)?.sample), options: () => all.find((one) => one.name === select.value)?.options ?? {} };
}

/** Upload a file, and ask in `place` what is missing: how it is read, or what becomes of an older one of its name.

`done(made)` with what the service stored. */
export async function addFile(kind, file, place, done, said = {}) {
  put(place, el("p", { class: "small soft", role: "status" }, t`Adding ${file.name}…`));
  try {
    const made = await upload(kind, file, said);
    rememberChoice(kind, made.name);
    await done(made);
    put(place);
  } catch (error) {
    const again = (more) => addFile(kind, file, place, done, { ...said, ...more });
    const taken = error.status === 409 && error.parameter === "name" && !said.replace;
    put(place, sorry(error), taken ? nameTaken(file, said, again) : (HOW.has(error.parameter) || said.crs) && howToRead(said, again));
    place.querySelector("button, input")?.focus();
  }
}

// A file of that name is there already.
function nameTaken(file, said, again) {
  const stem = said.name ?? file.name.replace(/\.[^.]*$/, ""), name = el("input", { name: "upload-name", value: `${stem} 2`, maxlength: "100" });
  return el("div", { class: "panel stack", role: "group", "aria-label": "The name is taken" },
    el("p", { class: "small" }, "If this is the corrected file, replace the older one. Plans made from the older one keep it."),
    el("div", {}, button("Replace the older file", () => again({ replace: true }), "main small")),
    el("div", { class: "row" }, el("div", { class: "grow" }, labelled("Or keep both and call this one", name)), button("Add under this name", () => again({ name: name.value.trim() }), "small")));
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

/** The tractor of a plan request as its file calls it; with a farm, as it is chosen there. */
export async function nameTractor({ tractor = "", farm = "" }) {
  if (farm) return tractor || t`First tractor of ${farm}`;
  const summary = await get(`tractors/${part(tractor || SAMPLE_TRACTOR)}/summary`).catch(() => null);
  return summary?.name ?? tractor;
}

/** The field of a name, with its rings in metres: {field, error, fields} as the reader has it.

`how` says which of several (key) and how the file is read (local, swap_axes, crs); what is left out is as it was uploaded. */
export function fieldSummary(name, how = {}) {
  const given = Object.entries(how).filter(([, value]) => value !== null && value !== undefined && value !== "");
  return get(`fields/${part(name)}/summary${given.length ? `?${new URLSearchParams(given)}` : ""}`);
}
