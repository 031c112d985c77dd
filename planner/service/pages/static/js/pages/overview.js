// All fleets on one map: positions, waiting, progress, alarms; stop-all within reach.
import { el, put, say, button, heading, note, facts } from "../dom.js";
import { t, translate } from "../language.js";
import { items } from "../api.js";
import { FleetLive } from "../fleetlive.js";
import { LiveMap } from "../livemap.js";
import { tractorTiles, alarmList, stopAll, refusals } from "../board.js";
import { mapLegend, LIVE } from "../legend.js";
import { capital, percent, plural, timeOfDay, DASH, LOOKS } from "../words.js";

const LOOK_AGAIN_MS = 5000, TELL_MS = 250, OVER = new Set(["done"]);
const stateOf = (one) => one.fleet?.state ?? "";

// Running fleets first, then the newest: the map opens on the first.
const running = (a, b) => (stateOf(b) === "running") - (stateOf(a) === "running") || (a.created < b.created) - (a.created > b.created);

export async function open(main, shell) {
  shell.title("Overview");
  const known = (await items("fleets")).sort(running);
  if (!known.length) return empty(main);
  const lives = new Map(), active = () => [...lives.values()];
  const add = (one) => lives.has(one.id) || lives.set(one.id, begin(one));
  const messages = el("div", { class: "messages stack" });
  const begin = (one) => {
    const live = new FleetLive(one.id, one.name ?? one.id);
    messages.append(refusals(live));
    live.watch((kind) => { if (kind === "scene") { fields(); map.fit(); } });
    return live;
  };
  const map = new LiveMap("Map of all fleets", { lives: active });
  map.view.clicked = (place) => { const hit = map.nearest(place); if (hit) location.hash = `#/fleet/${encodeURIComponent(hit.live.id)}/tractor/${hit.number}`; };
  const tiles = tractorTiles(active, { fleetName: () => lives.size > 1 }), alarms = alarmList(active, { fleetName: () => lives.size > 1 }), stop = stopAll(active);
  const fleets = el("div", { class: "cards" }), choice = el("div", { class: "row", role: "group", "aria-label": "Fields to be shown" }), below = el("div", { class: "under", hidden: true }, choice);
  const fields = () => {
    const groups = map.groups();
    below.hidden = groups.length < 2;
    if (map.only !== null && map.only >= groups.length) map.only = null;
    const action = (words, only) => button(words, () => { map.only = only; map.fit(); fields(); }, "small", { "aria-pressed": String(only === map.only) });
    put(choice, action("All", null), groups.map((names, group) => action(names.join(", "), group)),
      el("span", { class: "small soft" }, "Fields far apart are drawn beside each other."));
  };
  put(main, heading("Overview", "", alarms.sign, stop.node), messages,
    el("div", { class: "board" },
      el("div", { class: "panel flush map-box" }, map.node, below, el("div", { class: "under" }, mapLegend(LIVE))),
      el("div", { class: "stack side" }, el("section", {}, el("h2", {}, "Alarms"), alarms.node), el("section", {}, el("h2", {}, "Tractors"), tiles.node)),
      el("section", { class: "rest" }, el("h2", {}, "Fleets"), fleets)));
  main.classList.add("has-stop");
  known.filter((one) => !one.error && !OVER.has(stateOf(one))).forEach(add);
  if (!lives.size) known.slice(0, 1).forEach(add);
  const rows = new Map();
  const row = (one) => {
    if (!rows.has(one.id)) { rows.set(one.id, fleetTile(one)); fleets.append(rows.get(one.id).node); }
    rows.get(one.id).update(one, lives.get(one.id));
  };
  let listed = known;
  const tell = () => {
    listed.forEach(row);
    tiles.update(); alarms.update(); stop.update();
  };
  tell();
  const telling = setInterval(tell, TELL_MS);
  const looking = setInterval(async () => {
    listed = await items("fleets").catch(() => listed);
    listed.filter((one) => !one.error && !OVER.has(stateOf(one))).forEach(add);
  }, LOOK_AGAIN_MS);
  return () => { clearInterval(telling); clearInterval(looking); map.close(); active().forEach((live) => live.close()); };
}

function fleetTile(one) {
  const state = el("span", { class: "badge" }), more = el("p", { class: "small soft" }), name = el("b", {}, one.name ?? one.id);
  const node = el("a", { class: "tile", href: `#/fleet/${encodeURIComponent(one.id)}` },
    el("div", { class: "grow" }, el("p", { class: "row" }, name, state), more), el("span", { "aria-hidden": "true" }, "\u203A"));
  const update = (item, live) => {
    const now = live?.fleet?.state ? live.fleet : item.fleet ?? {}, words = now.state ?? DASH;
    say(state, capital(translate(words)));
    state.className = `badge ${LOOKS[words] ?? ""}`;
    const count = live?.numbers().length || item.tractors?.length || 0;
    say(more, item.error ?? [count ? plural(count, "tractor") : "", now.done_pct >= 0 ? t`${percent(now.done_pct)} worked` : "",
      typeof now.eta_s === "number" && words !== "done" ? t`done ${timeOfDay(now.eta_s)}` : ""].filter(Boolean).join(" \u00B7 "));
  };
  return { node, update };
}

function empty(main) {
  put(main, heading("Overview"), el("div", { class: "panel empty" },
    el("h2", {}, "No fleet yet"),
    el("p", {}, "Plan a field, choose a plan from the table, and send it out. Its tractors then appear here on one map."),
    el("div", { class: "actions" }, el("a", { class: "button main", href: "#/plan" }, "Plan a field"))));
  return () => {};
}
