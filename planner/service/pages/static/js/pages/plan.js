// Plan a field: choose or draw it, choose machines and deadline, and run. The result has a page of its own.
import { el, put, button, heading, labelled, option, sorry, lookingOnly } from "../dom.js";
import { post, upload, part, token } from "../api.js";
import { filePicker } from "../files.js";
import { fieldEditor } from "../drawfield.js";
import { fieldMap } from "../fieldmap.js";
import { earlier } from "../jobs.js";
import { number } from "../words.js";

const STRATEGIES = ["row-by-row", "row-by-row-optimised", "col-by-col", "split-field", "interleaved"];
const USUAL = ["split-field", "interleaved"];
const MORE = [
  ["speed_kmh", "Working speed, km/h", "5"], ["turn_speed_kmh", "Turn speed, km/h", ""], ["headland", "Headland depth, m", "as turns need"],
  ["bearing", "Direction of tracks, degrees", "the best"], ["radius", "Turning radius, m", "of the tractor"], ["clearance", "Least distance between machines, m", "0.5"],
  ["margin", "Distance to obstacles and fences, m", "0.3"], ["entrance", "Entrance: LON,LAT", "of the file"], ["price_per_hour", "Price per tractor and hour", "40"],
  ["price_per_tractor", "Price per tractor brought", "0"], ["budget", "Budget", ""], ["refill", "Refill: headland, tender or LON,LAT", ""], ["obstacle", "More obstacles: LON,LAT,RADIUS", "none; several with ; between"], ["seed", "Seed", "1"],
];
const CHOICES = [["operation", "Work", ["till", "sow", "spray", "harvest", "mow"]], ["turn", "Turns", ["auto", "u", "omega", "switch-back"]], ["corners", "Corners", ["auto", "square", "round"]],
  ["objective", "Objective", ["", "fastest", "cheapest", "surest"]]];
const NUMBERS = new Set(["width", "speed_kmh", "turn_speed_kmh", "headland", "bearing", "radius", "clearance", "margin", "price_per_hour", "price_per_tractor", "budget", "seed"]);

export async function open(main, shell) {
  shell.title("Plan");
  const PLACED = ["entrance", "refill", "obstacle"];
  const preview = fieldMap((name, text) => { form.elements[name].value = text; }), closing = [preview.close];
  const look = () => preview.show(field.value(), { key: parcel.value, crs: crs.value.trim(), local: local.checked, swap_axes: swap.checked });
  const [local, swap] = ["local", "swap_axes"].map((name) => el("input", { type: "checkbox", name, onchange: look })), crs = el("input", { name: "crs", placeholder: "as in the file", spellcheck: "false", onchange: look });
  const reading = el("details", {}, el("summary", {}, "How the file is read"), el("label", { class: "check" }, local, "The file is in local metres"),
    el("label", { class: "check" }, swap, "Latitude or northing comes first"), labelled("Coordinate system", crs, "For example EPSG:25832; only for a file that names none."));
  preview.refused = (error) => { if (["local", "swap_axes", "crs"].includes(error.parameter)) reading.open = true; };
  const parcel = el("select", { name: "parcel", onchange: look }), along = el("select", { name: "guidance_line" });
  const ofSeveral = labelled("Field of the file", parcel), byLine = labelled("Lay the tracks", along);
  ofSeveral.hidden = byLine.hidden = true;
  preview.update = ({ fields = [], field: shape }) => {
    ofSeveral.hidden = fields.length < 2;
    if (fields.length > 1 && parcel.options.length < 2) put(parcel, option("", "choose one"), fields.map((one) => option(keyOf(one, fields), `${one.key} (${number(one.area_ha, 2, "ha")})`)));
    const lines = shape?.lines ?? [], before = along.value;
    byLine.hidden = !lines.length;
    put(along, option("", "in the best direction"), lines.map((one) => option(one.name, `along ${one.name}`, one.name === before)));
  };
  const another = () => {
    const said = field.options();
    [local.checked, swap.checked, crs.value] = [Boolean(said.local), Boolean(said.swap_axes), said.crs ?? ""];
    put(parcel);
    put(along);
    ofSeveral.hidden = byLine.hidden = true;
    look();
  };
  let field = null;
  field = await filePicker("fields", "Field", { accept: ".geojson,.json,.zip,.kml,.kmz,.gpkg,.gpx,.xml", first: "iwamizawa", changed: () => field && another(), hint: "GeoJSON, KML, GeoPackage, GPX, or a zip with a Shapefile, ISOXML or AgOpenGPS field." });
  another();
  const tractor = await filePicker("tractors", "Tractor", { accept: ".toml", first: "eg105" }), farm = await filePicker("farms", "Farm", { accept: ".toml", none: "no farm file" });
  const rain = await filePicker("tables", "Rain by a table", { accept: ".csv", none: "no table", hint: "One row per ensemble member of the forecast: time or hours." }), gnss = await filePicker("tables", "GNSS errors by a table", { accept: ".csv", none: "no table", hint: "Made with headland gnss fit." });
  const trouble = el("div"), form = el("form", { class: "stack steps", novalidate: true });
  const input = (name, title, value = "", hint = "", more = {}) => labelled(title, el("input", { name, value, ...more }), hint);
  const drawn = el("div"), drawing = el("details", {}, el("summary", {}, "Draw a field"), drawn), change = button("Change this field", () => edit(true), "small");
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
  const strategies = el("fieldset", {}, el("legend", { class: "small" }, "Strategies"), el("div", { class: "grid" }, STRATEGIES.map((name) =>
    el("label", { class: "check" }, el("input", { type: "checkbox", name: "strategy", value: name, checked: USUAL.includes(name) }), name))));
  const run = el("button", { class: "main" }, "Run the plan");
  put(form,
    el("section", { class: "panel stack" }, el("h2", {}, "Field"), el("div", { class: "two even" }, el("div", { class: "stack" }, field.node, el("div", { class: "row" }, change), ofSeveral, byLine, reading), preview.node), drawing),
    el("section", { class: "panel stack" }, el("h2", {}, "Machines"),
      el("div", { class: "grid" }, input("width", "Working width, m", "3", "", { inputmode: "decimal" }), input("tractors", "Tractors", "1-3", "3, 1-6 or 1,3,5"), input("implement", "Implement of the farm", "", "by its name")),
      strategies, el("details", {}, el("summary", {}, "Tractor and farm files"), el("div", { class: "two even" }, tractor.node, farm.node))),
    el("section", { class: "panel stack" }, el("h2", {}, "Time and weather"),
      el("div", { class: "grid" }, input("start", "Start", "", "13:00"), input("deadline", "Done by", "", "17:00; next day if before the start"), input("rain", "Rain", "", "17:00, or 16:30=20,17:00=50 in percent")),
      el("details", {}, el("summary", {}, "More options"),
        el("div", { class: "grid" }, CHOICES.map(([name, title, all]) => labelled(title, el("select", { name }, all.map((one) => option(one, one || "default"))))), MORE.map(([name, title, hint]) => input(name, title, "", hint))),
        el("div", { class: "grid" }, [["no_headland", "Do not work the headland"], ["all", "Simulate every plan, however slow"], ["gnss", "Simulate GNSS errors"]].map(([name, words]) =>
          el("label", { class: "check" }, el("input", { type: "checkbox", name }), words))),
        el("div", { class: "two even" }, rain.node, gnss.node))),
    trouble, el("div", { class: "row" }, run));
  for (const name of PLACED) form.elements[name].addEventListener("input", (event) => preview.setPlace(name, event.target.value));
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    run.disabled = true;
    put(trouble);
    for (const marked of form.querySelectorAll("[aria-invalid]")) marked.removeAttribute("aria-invalid");
    try {
      const job = await post("plans", requestOf(form, { field: parcel.value ? `${field.value()}#${parcel.value}` : field.value(), said: field.options(), tractor: tractor.value(), farm: farm.value(), rain: rain.value(), gnss: gnss.value() }));
      location.hash = `#/plan/${part(job.id)}`;
    } catch (error) {
      refused(form, trouble, error);
    } finally {
      run.disabled = false;
    }
  });
  put(main, heading("Plan a field", "Every fleet size and strategy is simulated and ranked by time, tractors and cost."), !token.get() && lookingOnly(), form, await earlier("plans", "plan", "Earlier plans"));
  return () => closing.forEach((close) => close());
}

// The form's values under the service's names; text that is not a number is sent as it is, and the service refuses it.
function requestOf(form, files) {
  const request = {}, given = new FormData(form);
  for (const [name, value] of given) {
    const text = String(value).trim();
    if (!text || ["strategy", "fields", "tractors_file", "farms", "tables", "parcel"].includes(name) || value instanceof File) continue;
    const isFile = form.elements[name] instanceof RadioNodeList;
    if (isFile) continue;
    request[name] = form.elements[name].type === "checkbox" ? true : NUMBERS.has(name) && Number.isFinite(Number(text)) ? Number(text) : text;
  }
  request.tractors = form.querySelector("input[name=tractors]").value.trim() || "1-6";
  request.strategies = given.getAll("strategy").join(",") || "all";
  request.field = files.field;
  if (request.obstacle) request.obstacle = request.obstacle.split(/[;\s]+/).filter(Boolean);
  if (files.tractor && !(files.farm && files.tractor === "eg105")) request.tractor = files.tractor;
  if (files.farm) request.farm = files.farm;
  if (files.rain && !request.rain) request.rain = `${files.rain}.csv`;
  if (files.gnss) request.gnss_table = files.gnss;
  for (const name of ["local", "swap_axes"]) if (files.said[name]) request[name] = form.elements[name].checked;
  for (const name of ["operation", "turn", "corners"]) if (request[name] === form.elements[name].options[0].value) delete request[name];
  return request;
}

function refused(form, trouble, error) {
  const name = error.parameter === "strategies" ? "strategy" : error.parameter;
  const control = name ? form.querySelector(`[name="${CSS.escape(name)}"]`) : null;
  put(trouble, sorry(error));
  control?.closest("details")?.setAttribute("open", "");
  control?.setAttribute("aria-invalid", "true");
  (control ?? trouble).scrollIntoView({ block: "center" });
  control?.focus();
}

// A field of several is chosen by its key if that is unique, else by its position.
const keyOf = (one, all) => (one.key && all.filter((other) => other.key === one.key).length === 1 ? one.key : String(one.position));
