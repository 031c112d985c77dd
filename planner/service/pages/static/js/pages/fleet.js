// One live fleet: map, tractors, pause and resume, obstacles, failed tractors, the new plan for the others.
import { el, put, say, button, heading, facts, note, labelled, option } from "../dom.js";
import { t, translate, translateAll } from "../language.js";
import { get, items, remove, save, part } from "../api.js";
import { FleetLive } from "../fleetlive.js";
import { LiveMap } from "../livemap.js";
import { tractorTiles, alarmList, stopAll, refusals, fleetFacts } from "../board.js";
import { polygon, line } from "../layers.js";
import { mapLegend, LIVE } from "../legend.js";
import { colours } from "../palette.js";
import { capital, clock, moment, plural, LOOKS } from "../words.js";

const TELL_MS = 250, LEAST_CORNERS = 3;
// Holds that "Resume" ends; a tractor that waits for another, or has failed, still stands.
const RESUMED = new Set(["paused", "stopped by stop-all", "the service began anew", "remote control"]);

export async function open(main, shell, [id]) {
  const about = await get(`fleets/${part(id)}`);
  const live = new FleetLive(id, about.name ?? id), one = () => [live];
  shell.title(live.name);
  const map = new LiveMap(t`Map of ${live.name}`, { lives: one });
  live.watch((kind) => { if (kind === "scene") { map.fit(); failing(); obstacles(); } if (kind === "proposal") proposed(); });
  const tiles = tractorTiles(one), alarms = alarmList(one), stop = stopAll(one), said = refusals(live);
  if (about.error) said.append(note(about.error, "error"));
  const state = el("span", { class: "badge" }), figures = el("div"), log = el("ul", { class: "cards alarms small" });
  const start = button("Start", () => live.send({ kind: "start" }), "main"), pause = button("Pause all", () => live.send({ kind: "pause", tractor: null })),
    resume = button("Resume", () => live.send({ kind: "resume", tractor: null }), "main");
  const drawer = obstacleDrawer(live, map), proposal = el("div"), which = el("select", { "aria-label": "Tractor that failed" });
  const offer = (select, ...options) => {  // what is chosen stays chosen
    const chosen = select.value;
    put(select, ...options);
    if ([...select.options].some(({ value }) => value === chosen)) select.value = chosen;
  };
  const failing = () => {
    offer(which, live.numbers().map((number) => option(String(number), t`Tractor ${number}`)));
    offer(leftOut, option("", "With all tractors"), live.numbers().map((number) => option(String(number), t`Without tractor ${number}`)));
  };
  const fail = button("Plan without it", () => {
    const tractor = Number(which.value);
    if (live.send({ kind: "fail", tractor })) live.send({ kind: "replan", without: [tractor] });
  }, "danger");
  const repaired = button("It works again", () => live.send({ kind: "recover", tractor: Number(which.value) }));
  // All that is left planned anew from where everybody is; it is sent by "Send to the tractors".
  const leftOut = el("select", { "aria-label": "Who goes on" });
  const onward = button("Go on from here", () => live.send({ kind: "replan", without: leftOut.value ? [Number(leftOut.value)] : [] }));
  const proposed = () => { put(proposal, live.proposal && proposalNote(live)); map.view.redraw(); };
  const drawCorners = map.extra;
  map.extra = (ctx, view) => { drawCorners(ctx, view); drawProposal(ctx, view, live); };
  const inWay = el("ul", { class: "cards" });
  const obstacles = () => put(inWay, live.scene.marked.map((one) => el("li", { class: "tile" }, el("span", { class: "grow" }, one.name),
    button("Remove", () => live.send({ kind: "clear", obstacle: one.id }), "small", { disabled: !live.mayControl }))));
  const recording = button("Save recording", () => save(`fleets/${part(id)}/recording`, `${live.name}.zip`).catch((error) => put(said, note(error.message, "error"))));
  const away = button("Remove this fleet", async () => {
    if (!confirm(t`Remove ${live.name} with its recording?`)) return;
    try { await remove(`fleets/${part(id)}`); location.hash = "#/"; } catch (error) { put(said, note(error.message, "error")); }
  }, "danger small");
  put(main, heading(live.name, "", state, alarms.sign, stop.node), said, proposal,
    el("div", { class: "board rest-first" },
      el("div", { class: "panel flush map-box" }, map.node, el("div", { class: "under" }, mapLegend(LIVE), drawer.node)),
      el("div", { class: "stack rest" }, figures,
        el("div", { class: "actions" }, start, pause, resume, recording, el("a", { class: "button", href: `#/replay/${part(id)}` }, "Replay")),
        el("div", { class: "row" }, onward, el("div", { class: "grow" }, leftOut))),
      el("div", { class: "stack side" },
        el("section", {}, el("h2", {}, "Alarms"), alarms.node),
        el("section", {}, el("h2", {}, "Tractors"), tiles.node),
        el("details", { class: "panel" }, el("summary", {}, "Failures, obstacles, removal"),
          el("p", { class: "small soft" }, "All that is left is planned anew for the others; you see the new plan before you send it."),
          el("div", { class: "row" }, el("div", { class: "grow" }, which), fail, repaired), inWay, el("div", { class: "row" }, away)),
        el("details", { class: "panel" }, el("summary", {}, "Who did what"), log))));
  main.classList.add("has-stop");
  let before = "";
  const tell = () => {
    const now = live.fleet.state ?? about.fleet?.state ?? "", held = live.numbers().some((number) => live.fixes.get(number).holds?.some((hold) => RESUMED.has(hold)));
    if (now !== before) {
      before = now;
      if (now === "running" && live.proposal?.state === "accepted") live.proposal = null;  // it is being driven
      proposed();
    }
    say(state, capital(translate(now || "not linked")));
    state.className = `badge ${LOOKS[now] ?? ""}`;
    start.hidden = now !== "ready";
    pause.hidden = now !== "running";
    away.hidden = now === "running";
    resume.hidden = now !== "stopped" && !(now === "running" && held);
    for (const action of [start, pause, resume, fail, repaired, away, onward, drawer.action]) action.disabled = !live.mayControl;
    figures.classList.toggle("stale", live.isOld());
    put(figures, facts(fleetFacts(live)));
    put(log, live.events.length ? live.events.map((event) => el("li", {}, eventWords(event))) : el("li", { class: "soft" }, "Nothing yet."));
    tiles.update(); alarms.update(); stop.update();
  };
  tell();
  // Events from before this page was opened.
  items(`events?fleet=${part(id)}`).then((known) => { live.events.push(...known.slice(-40).reverse()); }).catch(() => {});
  const telling = setInterval(tell, TELL_MS);
  return () => { clearInterval(telling); map.close(); live.close(); };
}

const eventWords = ({ time, who, what, data = {} }) =>
  [moment(time), who, translate(String(what).replaceAll("_", " ")), ...Object.entries(data ?? {}).filter(([, value]) => value !== null).map(([key, value]) => `${translate(key.replaceAll("_", " "))} ${Array.isArray(value) ? value.join(", ") : value}`)].filter(Boolean).join(" \u00B7 ");

function proposalNote(live) {
  const one = live.proposal;
  if (one.state === "accepted") return live.fleet.state === "stopped" ? note("The tractors have the new plan and stand: Resume lets them drive it.") : null;
  const said = translateAll(one.sentence ?? "");
  if (one.state === "failed") return note(said, "error");
  if (one.state === "planning") return note("All that is left is being planned anew, from where the tractors are.");
  return note([said, t`The new plan is on the map. Simulated: done in ${clock(one.eta_s)}.`].join(" "), "warn",
    button("Send to the tractors", () => live.send({ kind: "accept", proposal: one.id }), "main small", { disabled: !live.mayControl }),
    button("Dismiss", () => { live.proposal = null; live.tell("proposal"); }, "small"));
}

// The new legs of a proposal, work wide and ways thin, until it is sent.
function drawProposal(ctx, view, live) {
  const one = live.proposal;
  if (one?.state !== "ready") return;
  const [east, north] = live.origin;
  for (const { tractor, legs } of one.tractors) for (const leg of legs) {
    const points = leg.points_m.map(([x, y]) => [x - east, y - north]);
    line(ctx, view, points, colours.tractor(tractor), leg.implement ? 2.5 : 1, leg.implement ? [] : [3, 4]);
  }
}

// An obstacle is drawn by its corners; the legs that it touches are blocked, the others are driven.
function obstacleDrawer(live, map) {
  let corners = null;
  const words = el("span", { class: "small soft" });
  const name = el("input", { "aria-label": "Name of the obstacle", placeholder: "What is it?", maxlength: "60" });
  const end = () => { corners = null; map.node.classList.remove("drawing"); map.view.clicked = null; update(); map.view.redraw(); };
  const done = button("Block it", () => {
    const [east, north] = live.origin;
    live.send({ kind: "obstacle", polygon_m: corners.map(([x, y]) => [x + east, y + north]), name: name.value.trim() || "obstacle" });
    end();
  }, "main small"), cancel = button("Cancel", end, "small");
  const action = button("Mark an obstacle", () => {
    corners = [];
    map.node.classList.add("drawing");
    map.view.clicked = (place) => { corners.push(place); update(); map.view.redraw(); };
    update();
  }, "small");
  const box = el("div", { class: "row", hidden: true }, words, el("div", { class: "grow" }, name), done, cancel);
  const update = () => {
    box.hidden = !corners;
    action.hidden = Boolean(corners);
    done.disabled = !corners || corners.length < LEAST_CORNERS;
    say(words, corners ? t`Tap its corners on the map (${plural(corners.length, "corner")}).` : "");
  };
  map.extra = (ctx, view) => {
    if (!corners?.length) return;
    polygon(ctx, view, [corners], null, colours.off, 2.5);
    line(ctx, view, corners, colours.off, 2.5);
    for (const corner of corners) { const [x, y] = view.at(...corner); ctx.fillStyle = colours.off; ctx.fillRect(x - 4, y - 4, 8, 8); }
  };
  return { node: el("div", {}, action, box), action };
}
