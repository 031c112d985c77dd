// Replay: a recorded run of a fleet, or log files on this computer, on the map with a time slider and strip charts.
import { el, put, button, heading, note, labelled, who, sorry } from "../dom.js";
import { t, translate } from "../language.js";
import { bytes, items, part, text } from "../api.js";
import { textsOf } from "../zip.js";
import { MapView } from "../map.js";
import { Player, before } from "../player.js";
import { StripChart } from "../charts.js";
import { tractor, line } from "../layers.js";
import { mapLegend, RECORDED } from "../legend.js";
import { colours } from "../palette.js";
import { capital, LOOKS } from "../words.js";

const NEEDED = ["time_s", "easting_m", "northing_m"], BACK_S = 60;

export async function open(main, shell, [id = null]) {
  shell.title("Replay");
  const trouble = el("div"), stage = el("div", { class: "stack" }), closing = [];
  const show = (runs) => {
    closing.splice(0).forEach((close) => close());
    if (!runs.length) return put(stage, note("Nothing is recorded in it yet.", "warn"));
    closing.push(play(stage, runs));
  };
  const attempt = async (how) => { put(trouble); try { show(await how()); } catch (error) { put(trouble, sorry(error)); } };
  const file = el("input", { type: "file", accept: ".csv,.zip", multiple: true });
  file.addEventListener("change", () => attempt(async () => (await Promise.all([...file.files].map(runsOf))).flat()));
  const sample = button("Try it with a sample log", () => attempt(async () => [runOf({ name: "sample.csv", text: await text("logs/sample") })]));
  const fleets = (await items("fleets")).filter((fleet) => fleet.recorded || fleet.id === id);
  put(main, heading("Replay", "A recorded run or measured logs on the map."), trouble, stage,
    el("div", { class: "two even" },
      el("section", { class: "panel stack" }, el("h2", {}, "Recorded fleets"), fleets.length ? el("div", { class: "cards" }, fleets.map((fleet) =>
        el("a", { class: "tile", href: `#/replay/${part(fleet.id)}`, "aria-current": fleet.id === id ? "true" : null }, el("div", { class: "grow" }, el("b", {}, fleet.name ?? fleet.id)), el("span", { class: `badge ${LOOKS[fleet.fleet?.state] ?? ""}` }, capital(translate(fleet.fleet?.state ?? fleet.state ?? "kept")))))) : el("p", { class: "soft" }, "Nothing was recorded yet.")),
      el("section", { class: "panel stack" }, el("h2", {}, "Files on this computer"), labelled("Logs or a recording", file, "CSV files or a saved .zip; they are read in the browser and not uploaded."), el("div", { class: "row" }, sample))));
  if (id) await attempt(async () => (await textsOf(await bytes(`fleets/${part(id)}/recording`))).map(runOf));
  return () => closing.forEach((close) => close());
}

async function runsOf(file) {
  if (file.name.endsWith(".zip")) return (await textsOf(file)).map(runOf);
  return [runOf({ name: file.name, text: await file.text() })];
}

/** Numeric columns of a log; throws an Error that names a missing column. */
export function runOf({ name, text }) {
  const lines = text.split(/\r?\n/).filter((one) => one.trim() && !one.startsWith("#")), heads = (lines.shift() ?? "").split(",").map((one) => one.trim());
  const missing = NEEDED.find((one) => !heads.includes(one));
  if (missing) throw new Error(t`${name} has no column ${missing}; a log needs ${NEEDED.join(", ")}.`);
  const rows = lines.map((one) => one.split(",")), column = (key) => (heads.includes(key) ? rows.map((row) => (row[heads.indexOf(key)] === "" ? NaN : Number(row[heads.indexOf(key)]))) : null);
  return { name: name.replace(/\.csv$/, "").split("/").pop(), time: column("time_s"), x: column("easting_m"), y: column("northing_m"), heading: column("heading_deg"), speed: column("speed_mps"), steering: column("steering_command_deg") ?? column("steering_deg"), implement: column("implement") };
}

function play(stage, runs) {
  const first = Math.min(...runs.map((run) => run.time[0])), end = Math.max(...runs.map((run) => run.time.at(-1))) - first;
  const west = Math.min(...runs.map((run) => Math.min(...run.x.filter(Number.isFinite)))), south = Math.min(...runs.map((run) => Math.min(...run.y.filter(Number.isFinite))));
  const lanes = runs.map((run) => run.x.map((x, k) => [x - west, run.y[k] - south])), view = new MapView("Map of the recorded run");
  const at = (run, now) => before(run.time, now + first);
  const speed = new StripChart("Speed", { unit: "m/s", least: 1, last_s: BACK_S, series: runs.slice(0, 3).map((run, k) => ({ name: `${k + 1}`, colour: `t${k}` })) });
  const steering = new StripChart("Steering", { unit: "degrees, right positive", least: 5, both: true, decimals: 1, last_s: BACK_S, series: runs.slice(0, 3).map((run, k) => ({ name: `${k + 1}`, colour: `t${k}` })) });
  const rowsOf = (key, now) => {
    const times = new Set(runs.slice(0, 3).flatMap((run) => run.time.slice(before(run.time, now + first - BACK_S), at(run, now) + 1)));
    return [...times].sort((a, b) => a - b).map((time) => [time, ...runs.slice(0, 3).map((run) => (run[key] ? run[key][before(run.time, time)] : NaN))]);
  };
  const player = new Player({ end, rates: [1, 5, 20, 100], rate: 20, moved: (now) => { view.redraw(); speed.set(rowsOf("speed", now)); steering.set(rowsOf("steering", now)); } });
  view.layers = [(ctx) => {
    lanes.forEach((lane, k) => {
      ctx.globalAlpha = 0.3;
      line(ctx, view, lane, colours.tractor(k + 1), 1.2);
      ctx.globalAlpha = 1;
      line(ctx, view, lane.slice(0, at(runs[k], player.now) + 1), colours.tractor(k + 1), 2.2);
    });
    lanes.forEach((lane, k) => {
      const i = at(runs[k], player.now), j = Math.min(i + 1, lane.length - 1), move = Math.atan2(lane[j][0] - lane[i][0], lane[j][1] - lane[i][1]) * (180 / Math.PI);
      tractor(ctx, view, { x: lane[i][0], y: lane[i][1], heading: runs[k].heading?.[i] || move }, k + 1);
    });
  }];
  const all = lanes.flat().filter(([x, y]) => Number.isFinite(x + y)), most = (k) => all.reduce((high, p) => Math.max(high, p[k]), 5);
  view.fit([0, 0, most(0), most(1)]);
  put(stage, el("div", { class: "panel flush" }, view.node, el("div", { class: "under" }, player.node, el("ul", { class: "legend", "aria-label": "Tractors" }, runs.map((run, k) => el("li", {}, who(k + 1), run.name))), mapLegend(RECORDED))),
    el("section", { class: "panel" }, speed.node, steering.node));
  return () => [player, view, speed, steering].forEach((each) => each.close());
}
