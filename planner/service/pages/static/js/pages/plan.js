// Plan a field: choose or draw it, choose machines and deadline, and run. The result has a page of its own.
import { ACCEPTED } from "../accepted.js";
import { el, put, say, button, heading, labelled, note, option, sorry, lookingOnly } from "../dom.js";
import { t } from "../language.js";
import { get, post, text as readText, upload, part, token } from "../api.js";
import { SAMPLE_TRACTOR, filePicker, nameTractor } from "../files.js";
import { fieldEditor } from "../drawfield.js";
import { fieldMap } from "../fieldmap.js";
import { earlier, progressBar } from "../jobs.js";
import { liveAnswer } from "../liveanswer.js";
import { planAddress, requestOfAddress } from "../planaddress.js";
import { trackMap } from "../trackmap.js";
import { MACHINES, MORE, TIME, WORK, controlName, planOptions } from "../planoptions.js";
import { number } from "../words.js";

const USUAL = ["split-field", "interleaved"];
const ADDRESS_MS = 250; // browsers allow an address to change only so often

export async function open(main, shell, _parts, query) {
  shell.title("Plan");
  const draft = draftOf(requestOfAddress(query)), described = await get("forms/plan"), { labels, strategies: words } = described, options = planOptions(described);
  const PLACED = ["entrance", "refill", "obstacle"];
  const preview = fieldMap((name, text) => { form.elements[name].value = text; }), closing = [preview.close];
  const look = () => preview.show(field.value(), { key: parcel.value, crs: crs.value.trim(), local: local.checked, swap_axes: swap.checked });
  const [local, swap] = ["local", "swap_axes"].map((name) => el("input", { type: "checkbox", name, onchange: look })), crs = el("input", { name: "crs", placeholder: "as in the file", spellcheck: "false", onchange: look });
  const reading = el("details", {}, el("summary", {}, "How the file is read"), el("label", { class: "check" }, local, labels.local),
    el("label", { class: "check" }, swap, labels.swap_axes), labelled(labels.crs, crs, "For example EPSG:25832; only for a file that names none."));
  preview.refused = (error) => { if (["local", "swap_axes", "crs"].includes(error.parameter)) reading.open = true; };
  const keep = el("div"), change = button("Change this field", () => edit(true), "small", { disabled: true });
  const parcel = el("select", { name: "parcel", onchange: look }), along = el("select", { name: "guidance_line" });
  const ofSeveral = labelled("Field of the file", parcel), byLine = labelled(labels.guidance_line, along);
  ofSeveral.hidden = byLine.hidden = true;
  preview.update = ({ fields = [], field: shape }) => {
    ofSeveral.hidden = fields.length < 2;
    if (fields.length > 1 && parcel.options.length < 2) put(parcel, option("", "choose one"), fields.map((one) => option(one.key, `${one.key} (${number(one.area_ha, 2, "ha")})`)));
    if (draft.parcel && fields.length > 1) { parcel.value = draft.parcel; draft.parcel = ""; if (parcel.value) look(); }
    change.disabled = !shape?.geojson;
    put(keep, obstacleChoice(shape?.obstacles ?? [], draft.ignore ?? []));
    const lines = shape?.lines ?? [], before = along.value;
    byLine.hidden = !lines.length;
    put(along, option("", "in the best direction"), lines.map((one) => option(one.name, t`along ${one.name}`, one.name === (draft.guidance_line ?? before))));
    changed();
  };
  const another = () => {
    const said = draft.reading ?? field.options();
    draft.reading = null;
    change.disabled = true;
    [local.checked, swap.checked, crs.value] = [Boolean(said.local), Boolean(said.swap_axes), said.crs ?? ""];
    put(parcel);
    put(along);
    ofSeveral.hidden = byLine.hidden = true;
    look();
    changed();
  };
  let changed = () => {}; // until the form is whole
  const tracks = trackMap(() => { isMeant = true; changed(); }), live = liveAnswer(tracks.show);
  let field = null;
  field = await filePicker("fields", labels.field, { accept: ACCEPTED.fields, first: "iwamizawa", chosen: draft.fields, changed: () => field && another(), hint: "GeoJSON, KML, GeoPackage, GPX, or a zip with a Shapefile, ISOXML or AgOpenGPS field." });
  another();
  const ofFarm = el("div", { class: "grid" }), form = el("form", { class: "stack steps", novalidate: true });
  const machine = el("p", { class: "lead", role: "status" });
  let tractor = null, farm = null, latest = null;
  // The name of the file at once, then what the file calls the tractor.
  const showMachine = async () => {
    if (!farm) return;
    changed();
    const chosen = latest = { tractor: tractorOf(ofFarm, tractor.value(), farm.value()), farm: farm.value() };
    say(machine, chosen.tractor);
    const name = await nameTractor(chosen);
    if (chosen === latest) say(machine, name);
  };
  const listMachines = async (name) => {
    if (form.elements.width) options.leaveTo(form, name);
    put(ofFarm, name ? await machinesOf(name, draft, labels) : null);
    return showMachine();
  };
  ofFarm.addEventListener("change", showMachine);
  tractor = await filePicker("tractors", labels.tractor, { name: "tractor", accept: ".toml", first: SAMPLE_TRACTOR, chosen: draft.tractors, changed: showMachine });
  farm = await filePicker("farms", labels.farm, { accept: ".toml", none: "no farm file", chosen: draft.farms, changed: listMachines });
  showMachine();
  const rain = await filePicker("tables", "Rain by a table", { accept: ".csv", none: "no table", chosen: draft.rain, hint: "One row per ensemble member of the forecast: time or hours." }), gnss = await filePicker("tables", labels.gnss_table, { accept: ".csv", none: "no table", chosen: draft.gnss, hint: "Made with headland gnss fit." });
  const elevation = await filePicker("elevations", labels.elevation, { accept: ACCEPTED.elevations, none: "level ground", chosen: draft.elevation, hint: "A GeoTIFF, an ASCII grid, or points: CSV, GeoJSON, KML, GPX, or a zip with a Shapefile." });
  const trouble = el("div", { class: "trouble" });
  const drawn = el("div"), drawing = el("details", {}, el("summary", {}, "Draw a field"), drawn);
  let editor = null;
  const edit = (chosen) => {
    const shape = chosen ? preview.field() : null, name = field.value();
    if (chosen && !shape?.geojson) return;
    editor?.close();
    editor = fieldEditor(async (file, { name: called, local: isLocal, replace }, where) => {
      try {
        const made = await upload("fields", file, { name: called, local: isLocal, replace });
        await field.list(made.name);
        drawing.open = false;
      } catch (error) { put(where, sorry(error)); }
    }, { ...(shape ? { field: shape, name, mayReplace: !field.sample() && !parcel.value } : {}), near: preview.middle });
    put(drawn, editor.node);
    drawing.open = true;
  };
  closing.push(() => editor?.close());
  drawing.addEventListener("toggle", () => {
    if (drawing.open && !editor) edit(false);
    if (!drawing.open) { editor?.close(); editor = null; put(drawn); }
  });
  const strategies = el("fieldset", {}, el("legend", { class: "small" }, labels.strategies), el("div", { class: "grid" }, Object.entries(words).map(([name, label]) =>
    el("label", { class: "check" }, el("input", { type: "checkbox", name: "strategy", value: name, checked: draft.strategies ? draft.strategies.includes("all") || draft.strategies.includes(name) : USUAL.includes(name) }), label))));
  const run = el("button", { class: "main" }, "Run the plan"), progress = progressBar(), running = el("div", { class: "panel stack", hidden: true }, progress.node);
  put(form,
    el("section", { class: "panel stack" }, el("h2", {}, labels.tractor), machine, el("div", { class: "two even" }, tractor.node, farm.node), ofFarm),
    el("section", { class: "panel stack" }, el("h2", {}, "Field"), el("div", { class: "two even" }, el("div", { class: "stack" }, field.node, el("div", { class: "row" }, change), ofSeveral, byLine, keep, reading), preview.node), drawing),
    el("section", { class: "panel stack" }, el("h2", {}, "Machines"), options.grid(MACHINES)),
    el("section", { class: "panel stack" }, el("h2", {}, "Time, price and weather"), options.grid(TIME)),
    tracks.node,
    el("section", { class: "panel stack" }, el("h2", {}, "Work"), options.grid(WORK), strategies,
      el("details", {}, el("summary", {}, "More options"), MORE.map(([title, rows]) => [el("h3", {}, title), options.grid(rows)]),
        el("div", { class: "two even" }, rain.node, gnss.node), elevation.node)),
    trouble, el("div", { class: "row" }, run), running);
  if (draft.request) { options.write(form, draft.request); tracks.write(draft.request); } else if (farm.value()) options.leaveTo(form, farm.value());
  for (const name of PLACED) preview.setPlace(name, form.elements[name].value);
  for (const name of PLACED) form.elements[name].addEventListener("input", (event) => preview.setPlace(name, event.target.value));
  const asked = () => tracks.complete(requestOf(form, options.read(form), { field: parcel.value ? `${field.value()}#${parcel.value}` : field.value(), said: field.options(), tractor: tractor.value(), farm: farm.value(), rain: rain.value(), gnss: gnss.value(), elevation: elevation.value() }), described.options);
  let writing = 0, isMeant = Boolean(draft.request); // the values of a link, or what was changed here
  changed = () => {
    const values = asked();
    if (!live.change(values, isMeant) || !isMeant) return;
    clearTimeout(writing);
    writing = setTimeout(() => history.replaceState(null, "", planAddress(values)), ADDRESS_MS);
  };
  const mayPlan = (await get("me").catch(() => null))?.rights?.includes("plan");
  if (!mayPlan) changed = () => {};
  tracks.node.hidden = !mayPlan;
  closing.push(live.close, tracks.close, () => clearTimeout(writing));
  for (const kind of ["input", "change"]) form.addEventListener(kind, () => { isMeant = true; changed(); });
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    run.disabled = true;
    running.hidden = false;
    progress.tell("Checking what was asked");
    running.scrollIntoView({ block: "nearest" });
    put(trouble);
    for (const marked of form.querySelectorAll("[aria-invalid]")) for (const name of ["aria-invalid", "aria-describedby"]) marked.removeAttribute(name);
    try {
      const values = asked();
      if (tracks.waits()) {
        running.hidden = true;
        return put(trouble, note(tracks.waits(), "warn"));
      }
      location.hash = `#/plan/${part(live.takeDrive(values) ?? (await post("plans", values)).id)}`;
    } catch (error) {
      running.hidden = true;
      refused(form, trouble, error);
    } finally {
      run.disabled = false;
    }
  });
  const gone = [[field, draft.fields], [farm, draft.farms], [rain, draft.rain], [gnss, draft.gnss], [elevation, draft.elevation]].filter(([picker, name]) => name && picker.value() !== name).map(([, name]) => name);
  put(main, heading("Plan a field", "Every fleet size and strategy is simulated and ranked by time, tractors and cost."), !token.get() && lookingOnly(), gone.length > 0 && note(t`Not in the library, and so not what is shown: ${gone.join(", ")}. Add it, or choose another.`, "warn"), mayPlan ? el("div", { class: "beside" }, live.node, form) : form, await earlier("plans", "plan", "Earlier plans"));
  changed();
  return () => closing.forEach((close) => close());
}

// What a request puts in the form and in its pickers.
function draftOf(request) {
  if (!request) return {};
  const [, fields, parcel = ""] = /^([^#]*)#?(.*)$/s.exec(request.field ?? ""), rain = /^(.*)\.csv$/i.exec(request.rain ?? "")?.[1];
  const strategies = [request.strategies ?? "all"].flat().join(",");
  return { request: { ...request, rain: rain ? null : request.rain }, reading: { local: request.local, swap_axes: request.swap_axes, crs: request.crs }, fields, parcel, farms: request.farm ?? "", tractors: request.tractor, ofFarm: request.tractor, implement: request.implement, rain, gnss: request.gnss_table, elevation: request.elevation,
    strategies: strategies.split(","), ignore: [request.ignore ?? []].flat(), guidance_line: request.guidance_line };
}

// Tractor and implement by the names in a farm file.
async function machinesOf(name, draft, labels) {
  let form;
  try { form = await post("forms/farm", { text: await readText(`farms/${part(name)}`) }); } catch { return null; }
  const names = (key) => (Array.isArray(form.values[key]) ? form.values[key] : []).map((one) => one?.name).filter((one) => typeof one === "string");
  const choice = (key, title, first, chosen) => labelled(title, el("select", { name: key }, option("", first), names(key === "implement" ? "implements" : "tractors").map((one) => option(one, one, one === chosen))));
  return [choice("farm_tractor", "Tractor of the farm", "the first of the farm", draft.ofFarm), choice("implement", labels.implement, "the first that fits", draft.implement)];
}

// The tractor that a request names: one of the farm, else a file; without either the farm says which.
const tractorOf = (within, file, farm) => within.querySelector("[name=farm_tractor]")?.value || (farm && file === SAMPLE_TRACTOR ? "" : file);

// Obstacles of the field, each to be driven round or not.
function obstacleChoice(obstacles, ignored) {
  const key = (one) => (one.name && obstacles.filter((other) => other.name === one.name).length === 1 ? one.name : String(one.number));
  return obstacles.length ? el("fieldset", {}, el("legend", { class: "small" }, "Drive round these obstacles"),
    obstacles.map((one) => el("label", { class: "check" }, el("input", { type: "checkbox", name: "keep", value: key(one), checked: !ignored.includes(key(one)) }), `${one.number}: ${one.name || one.kind || "obstacle"}${one.assumed ? " (assumed)" : ""}`))) : null;
}

// The form's values and files under the service's names.
function requestOf(form, request, files) {
  const value = (name) => form.querySelector(`select[name="${name}"]`)?.value ?? "";
  if (!files.farm) request.tractors ??= "1-6";
  request.strategies = [...form.querySelectorAll("[name=strategy]:checked")].map((one) => one.value).join(",") || "all";
  request.field = files.field;
  const ignored = [...form.querySelectorAll("[name=keep]:not(:checked)")].map((one) => one.value);
  if (ignored.length) request.ignore = ignored;
  for (const name of ["guidance_line", "implement"]) if (value(name)) request[name] = value(name);
  const crs = form.elements.crs.value.trim(), tractor = tractorOf(form, files.tractor, files.farm);
  if (crs) request.crs = crs;
  if (tractor) request.tractor = tractor;
  if (files.farm) request.farm = files.farm;
  if (files.rain && !request.rain) request.rain = `${files.rain}.csv`;
  if (files.gnss) request.gnss_table = files.gnss;
  if (files.elevation) request.elevation = files.elevation;
  for (const name of ["local", "swap_axes"]) if (form.elements[name].checked || files.said[name]) request[name] = form.elements[name].checked;
  return request;
}

function refused(form, trouble, error) {
  const name = error.parameter ? controlName(error.parameter) : null;
  const control = name ? form.querySelector(`[name="${CSS.escape(name)}"]`) : null;
  put(trouble, sorry(error));
  control?.closest("details")?.setAttribute("open", "");
  if (control) {
    trouble.id = "refusal";
    control.setAttribute("aria-invalid", "true");
    control.setAttribute("aria-describedby", "refusal");
    control.closest("label")?.after(trouble);
  } else form.lastElementChild.previousElementSibling.before(trouble);
  (control ?? trouble).scrollIntoView({ block: "center" });
  control?.focus();
}
