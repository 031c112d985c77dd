// The options of a plan as controls, simple ones first, and the request that they make. What an option takes and what it is
// called is the service's, made from the request; order, hints and words of choices are given here.
import { el, labelled, option } from "./dom.js";
import { numberOf } from "./form.js";
import { CLOCKS, COUNTS, NUMBERS, slider } from "./slider.js";

const HEADLANDS = { headland_first: "before the tracks", headland_last: "after the tracks", no_headland: "not at all" };

export const MACHINES = [["width", { value: "3", hint: "By default that of the farm.", knob: { ...NUMBERS, min: 1, max: 12, step: 0.1, rest: 3 } }], ["tractors", { value: "1-3", hint: "3, 1-6 or 1,3,5; by default those of the farm.", knob: { ...COUNTS, min: 1, max: 8, step: 1, rest: 6 } }], ["speed_kmh", { hint: "By default 5, or that of the farm.", knob: { ...NUMBERS, min: 1, max: 20, step: 0.5, rest: 5 } }]];
export const WORK = [
  ["operation", {}],
  ["headland_order", { choices: ["", ...Object.keys(HEADLANDS)], words: { "": "as the work needs", ...HEADLANDS } }],
  ["headland_passes", { hint: "By default as many as turns need." }],
  ["corners", { words: { auto: "each as is quicker", square: "square, worked whole", round: "round, quicker" } }],
];
export const TIME = [["start", { hint: "Such as 13:00.", knob: { ...CLOCKS, rest: 480 } }], ["deadline", { hint: "Such as 17:00; earlier than the start is the next day.", knob: { ...CLOCKS, rest: 1020 } }], ["price_per_hour", { hint: "By default 40.", knob: { ...NUMBERS, min: 0, max: 200, step: 1, rest: 40 } }], ["rain", { hint: "17:00, or 16:30=20,17:00=50 in percent." }]];
export const MORE = [
  ["Machines", [
    ["draft", { hint: "Such as plough or disk-harrow; by default a cultivator or a drill. The guide lists them under implements." }], ["depth_cm", { hint: "By default the usual one." }],
    ["min_speed_kmh", { hint: "By default that of the farm." }], ["max_speed_kmh", { hint: "By default that of the farm." }], ["turn_speed_kmh", { hint: "By default as at work." }],
    ["turn", { words: { auto: "each as is quicker", u: "U-turn", omega: "loop (omega)", "switch-back": "with reversing (switch-back)" } }], ["radius", { hint: "By default that of the tractor." }], ["clearance", { hint: "By default 0.5." }], ["transport_width", { hint: "By default 3; its working width: it does not fold." }], ["sections", { hint: "By default 1: without sections." }],
  ]],
  ["Field", [
    ["headland", { hint: "Instead of passes." }], ["bearing", { hint: "By default the best." }], ["cell_bearing", { hint: "Such as 2=45; several with ; between." }],
    ["overhang", { hint: "By default 0.5." }], ["open_edges", {}], ["margin", { hint: "By default 0.3." }], ["part", { hint: "1 is the largest." }],
    ["entrance", { hint: "Longitude,latitude; by default that of the file." }], ["refill", { hint: "headland, tender, or longitude,latitude." }], ["obstacle", { hint: "Longitude,latitude,radius in metres; several with ; between." }],
  ]],
  ["Ground", [
    ["soil", { hint: "Such as loam, clay or soft; by default level ground without a load." }], ["moisture", { hint: "By default as a day or two after rain." }],
    ["rain_mm", { hint: "By day up to yesterday, such as 0,12,5; says the moisture." }], ["et0_mm", { hint: "By default 3." }],
    ["swaths", { words: { straight: "as the work needs", contour: "along contours" } }],
    ["elevation_crs", { hint: "For example EPSG:25832; only for a file that names none." }],
  ]],
  ["Costs", [
    ["price_per_tractor", { hint: "By default 0." }], ["budget", {}],
    ["objective", { words: { "": "best compromise", fuel: "one of least fuel" } }],
  ]],
  ["Simulation", [
    ["samples", { hint: "10000 with a deadline or rain." }], ["seed", { hint: "By default 1." }],
    ["all", {}], ["gnss", {}],
  ]],
];
const ROWS = [...MACHINES, ...WORK, ...TIME, ...MORE.flatMap(([, rows]) => rows)];

const controlOf = (form, name) => form.querySelector(`input[name="${name}"], select[name="${name}"]`);

/** The controls of what the service says of the options: grids of them, what they say, and setting them. */
export function planOptions({ labels, options }) {
  const every = ROWS.map(([name, here]) => ({ name, kind: "choice", words: {}, value: "", hint: "", ...here, ...options[name] }));
  const sliders = [];
  const control = ({ name, kind, choices, words, value, hint, knob }) => {
    if (kind === "check") return el("label", { class: "check" }, el("input", { type: "checkbox", name }), labels[name]);
    const node = kind === "choice" ? el("select", { name }, choices.map((one) => option(one, words[one] ?? one)))
      : el("input", { name, value, inputmode: kind === "number" ? "decimal" : null, spellcheck: "false" });
    if (!knob) return labelled(labels[name], node, hint);
    const beside = slider(labels[name], node, knob);
    sliders.push(beside);
    return el("div", { class: "knob" }, labelled(labels[name], node), beside.node, hint && el("span", { class: "hint" }, hint));
  };
  return {
    grid: (rows) => el("div", { class: "grid" }, rows.map(([name]) => control(every.find((one) => one.name === name)))),

    /** What the controls say, under the service's names; text that is not a number is sent as it is, and the service refuses it. */
    read(form) {
      const request = {};
      for (const { name, kind, choices } of every) {
        const node = controlOf(form, name), text = node.value.trim();
        if (kind === "check" ? !node.checked : !text || (kind === "choice" && text === choices[0])) continue;
        if (name === "headland_order") request[text] = true;
        else request[name] = kind === "check" ? true : kind === "number" ? numberOf(text) : kind === "list" ? text.split(/[;\s]+/).filter(Boolean) : text;
      }
      return request;
    },

    /** What the form itself begins with is left to a farm, and is said again without one. */
    leaveTo(form, farm) {
      for (const { name, value } of every.filter((one) => one.value)) {
        const node = controlOf(form, name);
        if (node.value === (farm ? value : "")) node.value = farm ? "" : value;
      }
      for (const one of sliders) one.follow();
    },

    /** Set the controls to an earlier request. */
    write(form, request) {
      for (const { name, kind, choices } of every) {
        const node = controlOf(form, name), given = name === "headland_order" ? Object.keys(HEADLANDS).find((one) => request[one]) : request[name];
        if (kind === "check") node.checked = given === true;
        else node.value = given === undefined || given === null ? (kind === "choice" ? choices[0] : "") : kind === "list" ? [given].flat().join("; ") : String(given);
      }
      for (const one of sliders) one.follow();
    },
  };
}

/** The name of the control that a parameter of the service belongs to. */
export const controlName = (parameter) => ({ strategies: "strategy", headland_first: "headland_order", headland_last: "headland_order", no_headland: "headland_order", farm: "farms", field: "fields", elevation: "elevations" }[parameter] ?? parameter);
