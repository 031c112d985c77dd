// The options of a plan as controls, simple ones first, and the request that they make. The service gives their labels.
import { el, labelled, option } from "./dom.js";
import { numberOf } from "./form.js";

const num = (hint = "", value = "") => ({ number: true, hint, value });
const HEADLANDS = { headland_first: "before the tracks", headland_last: "after the tracks", no_headland: "not at all" };

export const MACHINES = [["width", num("", "3")], ["tractors", { value: "1-3", hint: "3, 1-6 or 1,3,5." }], ["speed_kmh", num("By default 5, or that of the farm.")]];
export const WORK = [
  ["operation", { choices: ["till", "sow", "spray", "harvest", "mow"] }],
  ["headland_order", { choices: ["", ...Object.keys(HEADLANDS)], words: { "": "as the work needs", ...HEADLANDS } }],
  ["headland_passes", num("By default as many as turns need.")],
  ["corners", { choices: ["auto", "square", "round"], words: { auto: "each as is quicker", square: "square, worked whole", round: "round, quicker" } }],
];
export const TIME = [["start", { hint: "Such as 13:00." }], ["deadline", { hint: "Such as 17:00; earlier than the start is the next day." }], ["rain", { hint: "17:00, or 16:30=20,17:00=50 in percent." }]];
export const MORE = [
  ["Machines", [
    ["draft", { hint: "Such as plough or disk-harrow; by default a cultivator or a drill. The guide lists them under implements." }], ["depth_cm", num("By default the usual one.")],
    ["min_speed_kmh", num("By default that of the farm.")], ["max_speed_kmh", num("By default that of the farm.")], ["turn_speed_kmh", num("By default as at work.")],
    ["turn", { choices: ["auto", "u", "omega", "switch-back"], words: { auto: "each as is quicker", u: "U-turn", omega: "loop (omega)", "switch-back": "with reversing (switch-back)" } }], ["radius", num("By default that of the tractor.")], ["clearance", num("By default 0.5.")], ["sections", num("By default 1: without sections.")],
  ]],
  ["Field", [
    ["headland", num("Instead of passes.")], ["bearing", num("By default the best.")], ["cell_bearing", { many: true, hint: "Such as 2=45; several with ; between." }],
    ["overhang", num("By default 0.5.")], ["open_edges", { check: true }], ["margin", num("By default 0.3.")], ["part", num("1 is the largest.")],
    ["entrance", { hint: "Longitude,latitude; by default that of the file." }], ["refill", { hint: "headland, tender, or longitude,latitude." }], ["obstacle", { many: true, hint: "Longitude,latitude,radius in metres; several with ; between." }],
  ]],
  ["Ground", [
    ["soil", { hint: "Such as loam, clay or soft; by default level ground without a load." }], ["moisture", num("By default as a day or two after rain.")],
    ["rain_mm", { hint: "By day up to yesterday, such as 0,12,5; says the moisture." }], ["et0_mm", num("By default 3.")],
    ["swaths", { choices: ["", "contour"], words: { "": "as the work needs", contour: "along contours" } }],
    ["elevation_crs", { hint: "For example EPSG:25832; only for a file that names none." }],
  ]],
  ["Costs", [
    ["price_per_hour", num("By default 40.")], ["price_per_tractor", num("By default 0.")], ["budget", num()],
    ["objective", { choices: ["", "fastest", "cheapest", "surest", "fuel"], words: { "": "best compromise", fuel: "one of least fuel" } }],
  ]],
  ["Simulation", [
    ["samples", num("10000 with a deadline or rain.")], ["seed", num("By default 1.")],
    ["all", { check: true }], ["gnss", { check: true }],
  ]],
];
const ROWS = [...MACHINES, ...WORK, ...TIME, ...MORE.flatMap(([, rows]) => rows)];
export const CHOSEN_BY_DEFAULT = new Set(["operation", "turn", "corners"]);

export function optionControl([name, { choices = null, words = {}, check = false, number = false, value = "", hint = "" }], title) {
  if (check) return el("label", { class: "check" }, el("input", { type: "checkbox", name }), title);
  const control = choices ? el("select", { name }, choices.map((one) => option(one, words[one] ?? one))) : el("input", { name, value, inputmode: number ? "decimal" : null, spellcheck: "false" });
  return labelled(title, control, hint);
}

export const optionGrid = (rows, labels) => el("div", { class: "grid" }, rows.map((row) => optionControl(row, labels[row[0]])));
const controlOf = (form, name) => form.querySelector(`input[name="${name}"], select[name="${name}"]`);

/** What the controls say, under the service's names; text that is not a number is sent as it is, and the service refuses it. */
export function readOptions(form) {
  const request = {};
  for (const [name, { choices = null, check = false, number = false, many = false }] of ROWS) {
    const control = controlOf(form, name), text = control.value.trim();
    if (check ? !control.checked : !text) continue;
    if (choices && CHOSEN_BY_DEFAULT.has(name) && text === choices[0]) continue;
    if (name === "headland_order") request[text] = true;
    else request[name] = check ? true : number ? numberOf(text) : many ? text.split(/[;\s]+/).filter(Boolean) : text;
  }
  return request;
}

/** Set the controls to an earlier request. */
export function writeOptions(form, request) {
  for (const [name, { choices = null, check = false, many = false }] of ROWS) {
    const control = controlOf(form, name), given = name === "headland_order" ? Object.keys(HEADLANDS).find((one) => request[one]) : request[name];
    if (check) control.checked = given === true;
    else control.value = given === undefined || given === null ? (choices ? choices[0] : "") : many ? [given].flat().join("; ") : String(given);
  }
}

/** The name of the control that a parameter of the service belongs to. */
export const controlName = (parameter) => ({ strategies: "strategy", headland_first: "headland_order", headland_last: "headland_order", no_headland: "headland_order", farm: "farms", field: "fields", elevation: "elevations" }[parameter] ?? parameter);
