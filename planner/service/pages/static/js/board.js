// Beside the map: a row for each tractor, alarms, stop-all. Rows are made once and then updated.
import { el, put, say, button, who, note } from "./dom.js";
import { listed, t, translate } from "./language.js";
import { age, clock, hectares, inCm, kmh, legWords, moment, percent, span, timeOfDay, plural, DASH } from "./words.js";

const BY_PLAN = "waits for another by the plan"; // the other tractor is named beside it
const CONNECTIONS = { online: ["online", "good"], offline: ["offline", "off"], broken: ["connection broken", "off"] };

/** The connection of a tractor in words, and its badge. */
export function connectionOf(live, fix) {
  if (live.link !== "online") return ["no link to the service", "off"];
  return CONNECTIONS[fix.connection] ?? [fix.connection ?? DASH, ""];
}

/** The tractors that one waits for, in words; "" where there are none. */
export const waitedFor = (fix) => listed([...new Set((fix.waits_for ?? []).map((one) => t`tractor ${one.tractor}`))]);

const waitsWords = (fix) => waitedFor(fix) && t`waits for ${waitedFor(fix)}`;

/** A tile of one tractor that links to its page; `update()` refreshes it. */
export function tractorTile(live, number, { fleetName = () => false } = {}) {
  const badge = el("span", { class: "badge" }), title = el("b"), doing = el("span"), more = el("p", { class: "line" });
  const cells = Object.fromEntries(["age", "speed", "error", "eta", "late"].map((key) => [key, el("span")]));
  more.append(...Object.values(cells));
  const node = el("a", { class: "tile tractor", href: `#/fleet/${encodeURIComponent(live.id)}/tractor/${number}` },
    who(number), el("div", { class: "grow" }, el("p", { class: "row" }, title, badge), el("p", {}, doing), more));
  const update = () => {
    const fix = live.fixes.get(number) ?? {}, [words, look] = connectionOf(live, fix);
    say(title, fleetName() ? t`${live.name}, tractor ${number}` : t`Tractor ${number}`);
    say(badge, words);
    badge.className = `badge ${look}`;
    const legs = live.scene?.lanes[number - 1] ?? [];
    const done = legs.length && fix.leg >= legs.length;
    const waits = waitsWords(fix), holds = (fix.holds ?? []).filter((hold) => !waits || hold !== BY_PLAN);
    say(doing, [done ? "done" : legWords(live.leg(number)), waits, ...(holds.length ? holds : fix.mode && fix.mode !== "automatic" ? [fix.mode] : [])].filter(Boolean).map(translate).join(", "));
    const old = live.isOld(number);
    node.classList.toggle("stale", old);
    say(cells.age, old && live.age(number) !== null ? t`fix ${age(live.age(number))} old` : t`fix ${age(live.age(number))}`);
    say(cells.speed, kmh(fix.speed_mps));
    say(cells.error, typeof fix.error_m === "number" ? t`off by ${inCm(fix.error_m)}` : "");
    say(cells.eta, done ? "" : typeof fix.eta_s === "number" ? t`done ${timeOfDay(fix.eta_s)}` : "");
    say(cells.late, fix.late_s > 30 ? t`${span(fix.late_s)} late` : fix.late_s < -30 ? t`${span(fix.late_s)} early` : "");
    cells.late.className = fix.late_s > 30 ? "late" : "";
  };
  update();
  return { node, update };
}

/** Tiles of all tractors of fleets; `update()` adds new tractors. */
export function tractorTiles(lives, more = {}) {
  const node = el("div", { class: "cards", role: "list", "aria-label": "Tractors" }), tiles = new Map();
  const update = () => {
    for (const live of lives()) for (const number of live.numbers()) {
      const key = `${live.id}/${number}`;
      if (!tiles.has(key)) {
        tiles.set(key, tractorTile(live, number, more));
        node.append(el("div", { role: "listitem" }, tiles.get(key).node));
      }
      tiles.get(key).update();
    }
  };
  return { node, update };
}

/** Alarms of fleets, each with a button to acknowledge it: those that last first, then new ones, then critical ones. */
export function alarmList(lives, { fleetName = () => false } = {}) {
  const list = el("ul", { class: "cards alarms", "aria-label": "Alarms" }), node = el("div", { "aria-live": "polite" }, list);
  let shown = "";
  const update = () => {
    const all = lives().flatMap((live) => live.alarms.map((alarm) => ({ live, alarm })));
    const key = JSON.stringify(all.map(({ live, alarm }) => [live.id, alarm, live.mayControl]));
    if (key === shown) return;
    shown = key;
    const over = (one) => Boolean(one.alarm.over), seen = (one) => Boolean(one.alarm.acknowledged), grave = (one) => one.alarm.level === "critical";
    all.sort((a, b) => over(a) - over(b) || seen(a) - seen(b) || grave(b) - grave(a) || b.alarm.id - a.alarm.id);
    if (!all.length) return put(list, el("li", { class: "soft" }, "No alarms."));
    put(list, all.map(({ live, alarm }) => alarmTile(live, alarm, fleetName())));
  };
  update();
  const count = () => lives().reduce((sum, live) => sum + live.alarms.filter((one) => !one.acknowledged).length, 0);
  const sign = button("", () => node.scrollIntoView({ block: "center" }), "sign", { hidden: true });
  // The number of new alarms at the head of the page, with a link to them.
  const counted = () => { sign.hidden = !count(); say(sign, plural(count(), "new alarm")); };
  return { node, sign, update: () => { update(); counted(); } };
}

// What acknowledging an alarm does: it lets a tractor resume that stands because of an unreadable obstacle, or a fleet
// move that cannot be placed among the others.
function seeWords(alarm) {
  if (!alarm.over && alarm.code === "unread obstacle") return "Let it resume";
  return !alarm.over && alarm.code === "unknown ground" && alarm.level === "critical" ? "I keep the distance: let it move" : "Acknowledge";
}

function alarmTile(live, alarm, fleetName) {
  const seen = alarm.acknowledged;
  const look = `tile alarm ${alarm.level === "critical" ? "critical" : ""} ${seen ? "seen" : ""} ${alarm.over ? "over" : ""}`;
  return el("li", { class: look },
    el("div", { class: "grow" }, el("p", {}, el("b", {}, fleetName ? `${live.name}: ` : ""), alarm.sentence),
      el("p", { class: "small soft" }, [t`since ${moment(alarm.since)}`, seen ? (typeof seen === "string" ? t`seen by ${seen}` : translate("seen")) : "", alarm.over ? translate("over") : ""].filter(Boolean).join("; "))),
    !seen && button(seeWords(alarm), () => live.send({ kind: "acknowledge", alarm: alarm.id }), "small", { disabled: !live.mayControl }));
}

/** Stop-all: one press, no confirmation. It needs an operator's token, and says so without one. */
export function stopAll(lives) {
  const press = () => lives().forEach((live) => live.stopAll());
  const action = button("STOP ALL", press, "stop", { "aria-label": "Stop all tractors at once" });
  const why = el("a", { class: "small why", href: "#/access", hidden: true }, "View only: enter an operator\u2019s token to control tractors");
  const node = el("div", { class: "stopbar" }, why, action);
  const update = () => {
    const may = lives().some((live) => live.mayControl);
    action.disabled = !may;
    // Shown only once the link is up: before that the rights of the token are unknown.
    why.hidden = may || !lives().some((live) => live.link === "online");
  };
  update();
  return { node, update };
}

/** The last refusal of the service, until it is closed. */
export function refusals(live) {
  const node = el("div", { class: "messages" });
  live.watch((kind) => {
    if (kind !== "refused" || !live.said) return;
    put(node, note(live.said, "error", button("Close", () => put(node), "small")));
  });
  return node;
}

export function fleetFacts(live) {
  const fleet = live.fleet ?? {};
  const area = fleet.done_m2 >= 0 ? hectares(fleet.done_m2) : DASH;
  const pairs = [["Worked", percent(fleet.done_pct)], ["Area done", area],
    ["Done at", typeof fleet.eta_s === "number" && fleet.state !== "done" ? timeOfDay(fleet.eta_s) : DASH], ["Remaining", clock(fleet.state === "done" ? 0 : fleet.eta_s)]];
  if (typeof fleet.deadline_s === "number") pairs.push([fleet.deadline_s < 0 ? "Past the deadline" : "To the deadline", span(fleet.deadline_s)]);
  if (typeof fleet.probability === "number") pairs.push(["In time", percent(100 * fleet.probability)]);
  return pairs;
}

export const tractorsWords = (live) => plural(live.numbers().length, "tractor");
