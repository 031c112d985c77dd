// One tractor: its twin against its reports, their distance, a drawn view or video, and its controls.
import { el, put, say, button, heading, facts, note, who } from "../dom.js";
import { t, translate } from "../language.js";
import { get, post, part } from "../api.js";
import { FleetLive } from "../fleetlive.js";
import { LiveMap } from "../livemap.js";
import { StripChart } from "../charts.js";
import { Camera } from "../camera.js";
import { nearestThing, nearWords } from "../nearness.js";
import { tractorCover } from "../stale.js";
import { viewPanel } from "../video.js";
import { remotePanel } from "../remote.js";
import { alarmList, stopAll, refusals, connectionOf, waitedFor } from "../board.js";
import { mapLegend, LIVE } from "../legend.js";
import { colours } from "../palette.js";
import { age, capital, kmh, legWords, number as figure, span, timeOfDay, DASH } from "../words.js";

const TELL_MS = 200, TWIN_MS = 2000, CAMERA_MS = 100;

export async function open(main, shell, [id, text]) {
  const number = Number(text), about = await get(`fleets/${part(id)}`);
  const live = new FleetLive(id, about.name ?? id), one = () => [live];
  shell.title(t`Tractor ${number} of ${live.name}`);
  let follow = true;
  const map = new LiveMap(t`Map around tractor ${number}`, { lives: one, chosen: () => ({ live, number }), short: true, follow: () => (follow ? { live, number } : null) });
  const following = el("input", { type: "checkbox", checked: true, onchange: () => { follow = following.checked; if (!follow) map.fit(); } });
  live.watch((kind) => { if (kind === "scene") { map.fit(); map.view.scale = Math.max(map.view.scale, 9); } });
  const camera = new Camera(t`Drawn view along the heading of tractor ${number}`), cover = tractorCover(live, number);
  const view = viewPanel({ fleet: id, number, address: about.videos?.[number] ?? null, drawn: camera.node, cover: cover.node, mayChange: () => live.mayControl && !remote.isMine() });
  const near = el("p", { class: "near num", role: "group", "aria-label": "Distance to the nearest obstacle" });
  const charts = [
    new StripChart("Place", { unit: "cm", least: 5, decimals: 1, series: [{ name: "distance", colour: "t0" }] }),
    new StripChart("Heading", { unit: "degrees", least: 1, both: true, decimals: 2, series: [{ name: "difference", colour: "t1" }] }),
  ];
  const corrected = new StripChart("Corrections", { unit: "cm", least: 5, both: true, decimals: 1, series: [{ name: "ahead", colour: "t2" }, { name: "right", colour: "t3" }] });
  const urgent = el("p", { class: "urgent", hidden: true });
  const figures = el("div", { class: "figures" }), badge = el("span", { class: "badge" }), remote = remotePanel(live, number), alarms = alarmList(one), stop = stopAll(one), said = refusals(live);
  const doubt = el("div"), twin = twinPanel(id, number, doubt, corrected);
  const pause = button("Pause", () => live.send({ kind: "pause", tractor: number })), resume = button("Resume", () => live.send({ kind: "resume", tractor: number }));
  const head = heading(t`Tractor ${number}`, "", badge, alarms.sign, stop.node);
  head.querySelector("h1").prepend(who(number), " ");
  put(main, el("p", { class: "small" }, el("a", { href: `#/fleet/${part(id)}` }, `\u2039 ${live.name}`)), head, said, doubt,
    el("div", { class: "board" },
      el("div", { class: "stack map-box" },
        el("div", { class: "panel flush" }, map.node, el("div", { class: "under row" }, el("label", { class: "check" }, following, "Follow it"), mapLegend(LIVE))),
        urgent, near, figures),
      el("div", { class: "stack side" },
        view.node, el("div", { class: "row orders" }, pause, resume), remote.node),
      el("div", { class: "stack rest" },
        el("section", { class: "panel" }, el("h2", {}, "Twin against tractor"), el("div", { class: "strips" }, charts.map((chart) => chart.node), corrected.node), twin.node),
        el("section", {}, el("h2", {}, "Alarms"), alarms.node))));
  main.classList.add("has-stop");
  const tell = () => {
    const fix = live.fixes.get(number) ?? {}, [words, look] = connectionOf(live, fix);
    say(badge, words);
    badge.className = `badge ${look}`;
    const old = live.isOld(number);
    for (const each of [figures, near]) each.classList.toggle("stale", old);
    say(near, `${nearWords(nearestThing(live, number))} \u00B7 ${kmh(fix.speed_mps)}${old ? ` \u00B7 ${age(live.age(number))} old` : ""}`);
    document.body.classList.toggle("steering", remote.isMine());
    const [alarm] = live.alarms.filter((one) => !one.over && !one.acknowledged && one.level === "critical").sort((a, b) => b.id - a.id);
    urgent.hidden = !alarm;
    say(urgent, alarm?.sentence ?? "");
    view.tell();
    put(figures, facts([["Doing", capital(legWords(live.leg(number)))], ["Waits", waitedFor(fix) || "no"], ["Speed", kmh(fix.speed_mps)],
      ["Mode", capital(translate(fix.mode ?? DASH))], ["Age of fix", age(live.age(number))], ["Leg", Number.isInteger(fix.leg) ? t`${fix.leg + 1} of ${live.scene?.lanes[number - 1]?.length ?? DASH}` : DASH],
      ["Done at", typeof fix.eta_s === "number" ? timeOfDay(fix.eta_s) : DASH], ["Against plan", fix.late_s > 5 ? t`${span(fix.late_s)} late` : fix.late_s < -5 ? t`${span(fix.late_s)} early` : "on time"],
      ["Twin off by", figure(100 * fix.error_m, 1, "cm")]]));
    if (typeof fix.error_m === "number" && fix.connection === "online") {
      const now = performance.now() / 1000;
      charts[0].add(now, [100 * fix.error_m]);
      charts[1].add(now, [fix.error_deg]);
      charts.forEach((chart) => chart.draw());
    }
    for (const action of [pause, resume]) action.disabled = !live.mayControl;
    alarms.update(); stop.update(); remote.tell();
  };
  const look = () => { cover.update(); const pose = live.pose(number); if (view.isDrawn() && pose && live.scene) camera.draw(pose, live.scene, linesOf(live, number), othersOf(live, number)); };
  const timers = [setInterval(tell, TELL_MS), setInterval(look, CAMERA_MS), setInterval(twin.look, TWIN_MS)];
  tell();
  twin.look();
  return () => { document.body.classList.remove("steering"); timers.forEach(clearInterval); [...charts, corrected, camera, remote, map, live].forEach((each) => each.close()); };
}

// Worked strips near by, the base legs of this tractor, and the next legs.
function linesOf(live, number) {
  const fix = live.fixes.get(number) ?? {}, legs = live.scene.lanes[number - 1] ?? [];
  const painted = live.coverage.lines.map(({ tractor, points, width }) => ({ points, colour: colours.tractor(tractor), alpha: 0.35, strip_m: width }));
  const ahead = legs.slice(fix.leg ?? 0, (fix.leg ?? 0) + 6).map((leg, k) => ({ points: leg.points, colour: colours.tractor(number), width: k + (fix.leg ?? 0) < (fix.base_end ?? 0) ? 4 : 1.5 }));
  return [...painted, ...ahead];
}

const othersOf = (live, number) =>
  live.numbers().filter((other) => other !== number).map((other) => ({ ...live.pose(other), number: other })).filter((other) => other.x !== undefined);

// The state of the twin: its mismatch, the diagnosis of the cause, and adding that to the tractor file.
function twinPanel(id, number, doubt, chart) {
  const path = `twins/${part(id)}/${number}`, node = el("div");
  let shown = "", gone = false, saved = "";
  const ask = (what, done) => async (event) => {
    event.target.disabled = true;
    try { done(await post(`${path}/${what}`)); } catch (error) { put(doubt, note(error.message, "error")); }
  };
  const look = async () => {
    let answer;
    if (gone) return;
    try { answer = await get(path); } catch (error) { gone = error.status === 404; return; }
    chart.set(correctionRows(answer.corrections));
    const { doubt: wrong, diagnosis, finding } = answer, key = JSON.stringify([wrong?.words, diagnosis, finding, saved]);
    if (key === shown) return;
    shown = key;
    put(node, !wrong && el("p", { class: "small soft" }, "The corrections are within noise: the twin fits."));
    const find = button("Find the cause", ask("diagnose", () => { saved = ""; look(); }), "small main");
    const mend = button("Add it to the tractor file", ask("mend", (made) => { saved = t`Saved as the tractor file ${made.tractor}; use it for your next plans.`; look(); }), "small main");
    const read = diagnosis && el("a", { class: "button small", href: `#/diagnose/${part(diagnosis.id)}` }, "Read the diagnosis");
    const steps = { done: [read, finding?.extends_model && mend], failed: [find] }[diagnosis?.status] ?? (diagnosis ? [read] : [find]);
    const more = !diagnosis ? "" : { done: finding?.words ?? "The diagnosis of its recording is ready.", failed: diagnosis.error ?? "" }[diagnosis.status] ?? "Its recording is being diagnosed.";
    put(doubt, (wrong || diagnosis) && note([wrong?.words, more, saved].filter(Boolean).map(translate).join(" "), "warn", ...steps));
  };
  return { node, look };
}

/** Rows of time, ahead and to the right in centimetres, from columns. */
export function correctionRows(given) {
  if (!given) return [];
  const along = given.ahead_m ?? given.along_m ?? [], across = given.right_m ?? given.across_m ?? [];
  return (given.time_s ?? []).map((time, k) => [time, 100 * along[k], 100 * across[k]]);
}
