// The tracks of an estimate on a map: one can be left out, put first or given to a tractor, by pointer, touch or keys.
import { el, put, say, button, labelled, option } from "./dom.js";
import { t, translate } from "./language.js";
import { MapView } from "./map.js";
import { colours } from "./palette.js";
import { edge, line, soil } from "./layers.js";

const SAME_M = 0.5, SAME_SHARE = 0.2; // by which a track of another layout may lie aside or be longer and still be the same
const NEAR_PX = 12, WIDTH_PX = 3, CHOSEN_PX = 7, DASH = [5, 5], DROP_DASH = [3, 4];
const DROPPED = "Another layout: its tracks are numbered anew, and what was wanted of single ones is dropped.";
const RANGE = /^(R?)(\d+)(?:-R?(\d+))?$/;

/** The map; `changed()` when something else is wanted of a track. `show(answer, isLatest)` takes an estimate with its lines. */
export function trackMap(changed) {
  const view = new MapView("Tracks of the estimate", { short: true });
  const told = el("p", { class: "small", role: "status" }), wanted = el("p", { class: "small" });
  const choice = el("select", { onchange: () => choose(choice.value) });
  const out = button("Leave out", () => wish(chosen, "out"), "small"), first = button("Work first", () => wish(chosen, "first"), "small");
  const tractors = el("span", { class: "row" }), free = button("As planned", () => wish(chosen, null), "small"), clear = button("Clear all", () => { wishes.clear(); [kept, dropped] = [[], ""]; after(); }, "small");
  let lines = [], outlines = [], wishes = new Map(), chosen = "", dragging = null, fitted = "", layout = "", ground = "", pinned = {}, dropped = "";
  let kept = []; // lines of the layout before, each with what is wanted of it, until those of the next are there

  const byName = (name) => lines.find((one) => one.name === name);
  const count = () => Math.max(0, ...lines.map((one) => one.tractor ?? 0));
  const after = () => { tell(); changed(); };
  // A wish is "out", "first" or the number of a tractor; the one made last is worked first of all.
  const wish = (name, what) => {
    if (!name) return;
    dropped = "";
    wishes.delete(name);
    if (what !== null) wishes = new Map(what === "first" ? [[name, what], ...wishes] : [...wishes, [name, what]]);
    after();
  };
  const choose = (name) => { chosen = name; tell(); };
  const nearest = (at, mostM = NEAR_PX / view.scale) => {
    const gaps = lines.map((one) => [Math.min(...one.points.slice(1).map((to, k) => gap(at, one.points[k], to))), one]);
    const [metres, one] = gaps.reduce((best, other) => (other[0] < best[0] ? other : best), [Infinity, null]);
    return metres <= mostM ? one : null;
  };
  // The line that lies where one of another layout lay, and is about as long; null without one.
  const successor = ({ points }) => {
    const one = nearest(middleOf(points), SAME_M);
    return one && Math.abs(lengthOf(one.points) - lengthOf(points)) <= SAME_SHARE * lengthOf(points) ? one : null;
  };
  const takeKept = () => {
    const found = kept.map(([one, what]) => [successor(one)?.name, what]);
    wishes = new Map([...wishes, ...found.filter(([name]) => name)]);
    dropped = found.some(([name]) => !name) ? DROPPED : "";
    kept = [];
    if (wishes.size) changed();
  };

  view.clicked = (at) => choose(nearest(at)?.name ?? "");
  view.dragged = (phase, at) => {
    if (phase === "start") {
      const held = nearest(at);
      dragging = held && held.name === chosen ? { from: at, to: at } : null;
      return Boolean(dragging);
    }
    if (!dragging) return true;
    dragging.to = at;
    const other = nearest(at), taker = other && other.name !== chosen ? other.tractor : null;
    if (phase === "move") say(told, taker ? t`${describe(chosen)}: to tractor ${taker}` : t`${describe(chosen)}: drop it on a track of another tractor`);
    if (phase === "end") {
      dragging = null;
      if (taker && taker !== byName(chosen)?.tractor) wish(chosen, taker);
      else tell();
    }
    view.redraw();
    return true;
  };

  const draw = (ctx) => {
    if (!outlines.length) return;
    soil(ctx, view, outlines);
    edge(ctx, view, outlines, 2);
    for (const one of lines) {
      const isOut = wishes.get(one.name) === "out" || !one.tractor;
      line(ctx, view, one.points, isOut ? colours.soft : colours.tractor(one.tractor), one.name === chosen ? CHOSEN_PX : WIDTH_PX, isOut ? DASH : []);
    }
    for (const one of lines) if (wishes.has(one.name)) mark(ctx, view, one.points, wishes.get(one.name));
    if (dragging) line(ctx, view, [dragging.from, dragging.to], colours.ink, 2, DROP_DASH);
  };
  view.layers = [draw];

  const tell = () => {
    const one = byName(chosen);
    choice.value = one ? chosen : "";
    for (const [action, what] of [[out, "out"], [first, "first"], ...[...tractors.children].map((each, k) => [each, k + 1])]) {
      action.disabled = !one;
      action.setAttribute("aria-pressed", String(wishes.get(chosen) === what));
    }
    free.disabled = !wishes.has(chosen);
    clear.disabled = !wishes.size && !kept.length;
    say(told, one ? (one.tractor ? t`${describe(chosen)}: tractor ${one.tractor}, number ${one.place} of its tour` : t`${describe(chosen)}: left`) : translate("Tap a track to choose it; drag it onto a track of another tractor to give it to that one."));
    say(wanted, summary());
    view.redraw();
  };
  // Choices are made anew only where they are others, so that no focus is lost.
  const offer = (before) => {
    if (before.names !== names()) put(choice, option("", "none"), lines.map((each) => option(each.name, describe(each.name))));
    if (before.count !== count()) put(tractors, Array.from({ length: count() > 1 ? count() : 0 }, (_, k) => button(t`Tractor ${k + 1}`, () => wish(chosen, k + 1), "small")));
  };
  const names = () => lines.map((one) => one.name).join();
  const named = (what) => [...wishes].filter(([, one]) => one === what).map(([name]) => name);
  const summary = () => {
    const parts = [named("out").length && t`Left out: ${named("out").join(", ")}.`, named("first").length && t`First: ${named("first").join(", ")}.`];
    for (const k of takers()) parts.push(t`Tractor ${k}: ${named(k).join(", ")}.`);
    return [...parts, waits(), translate(dropped)].filter(Boolean).join(" ");
  };
  const waits = () => (kept.length ? translate("What is wanted of single tracks is looked up in the new layout: plan in a moment, or clear it.") : "");
  const takers = () => [...new Set(wishes.values())].filter(Number.isInteger).sort((a, b) => a - b);

  const node = el("section", { class: "panel stack" }, el("h2", {}, "Tracks"), view.node, told,
    labelled("Chosen track", choice), el("div", { class: "row", role: "group", "aria-label": "What is wanted of the chosen track" }, out, first, tractors, free), el("div", { class: "row" }, clear, wanted));
  return {
    node,
    close: () => view.close(),
    /** Why a request is not complete yet, "" where it is. */
    waits,
    /** The lines of an estimate; answers without any leave what is shown. */
    show(answer, isLatest) {
      if (!answer.lines?.length) return;
      const before = { names: names(), count: count() };
      [lines, outlines] = [answer.lines, answer.outlines];
      wishes = new Map([...wishes].flatMap(([text, what]) => namesOf(text, lines).map((name) => [name, what])));
      offer(before);
      // What is wanted by number holds for this layout alone: it stays pinned as long as anything is wanted.
      if (answer.is_layout_borrowed) pinned = { bearing: answer.bearing, headland_passes: answer.headland_passes };
      else if (!wishes.size) pinned = {};
      const box = JSON.stringify(outlines);
      if (box !== fitted) view.fit(bounds(outlines[0]));
      fitted = box;
      if (kept.length && isLatest) takeKept();
      tell();
    },
    /** A request with what is wanted. Another layout numbers its tracks anew: what was wanted is then wanted of the tracks
    that lie where those were, and of none on another field.

    `options` says which number tracks, as the form of a plan does. */
    complete(request, options) {
      const key = JSON.stringify(Object.entries(request).filter(([name]) => options[name]?.numbers_tracks ?? true).sort());
      if (request.field !== ground) kept = [];
      if (lines.length && key !== layout && wishes.size) {
        if (request.field === ground) kept.push(...[...wishes].map(([name, what]) => [byName(name), what]).filter(([one]) => one));
        else dropped = DROPPED;
        wishes.clear();
        tell();
      }
      [layout, ground] = [key, request.field];
      if (!wishes.size) return request;
      const [outs, firsts] = ["out", "first"].map((what) => named(what).join(",")), give = takers().map((k) => `${k}=${named(k).join(",")}`);
      return { ...request, ...(request.no_headland ? { bearing: pinned.bearing } : pinned), ...(outs && { leave_out: outs }), ...(firsts && { work_first: firsts }), ...(give.length && { give }) };
    },
    /** Take what an earlier request wanted. */
    write({ leave_out: outs, work_first: firsts, give } = {}) {
      const given = [give ?? []].flat().map((text) => String(text).split("="));
      wishes = new Map([...split(firsts).map((name) => [name, "first"]), ...split(outs).map((name) => [name, "out"]),
        ...given.flatMap(([taker, names]) => split(names).map((name) => [name, Number(taker)]))]);
      tell();
    },
  };
}

const describe = (name) => (name.startsWith("R") ? t`Headland pass ${name}` : t`Track ${name}`);
const split = (text) => [text ?? ""].flat().join().split(",").map((one) => one.trim()).filter(Boolean);

// The lines that a text names: 7-9, all pieces of 5, all sides of R1; the text where there are none.
function namesOf(text, lines) {
  const [, ring, low, high = low] = RANGE.exec(text) ?? [], numbered = lines.map(({ name }) => [name, ...(/^(R?)(\d+)/.exec(name) ?? []).slice(1)]);
  const names = numbered.filter(([name, itsRing, number]) => (low === undefined ? name === text : itsRing === ring && Number(low) <= Number(number) && Number(number) <= Number(high)));
  return names.length ? names.map(([name]) => name) : [text];
}

// From a place to a piece of line, metres.
function gap([x, y], [ax, ay], [bx, by]) {
  const [dx, dy] = [bx - ax, by - ay], along = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1), k = Math.min(1, Math.max(0, along));
  return Math.hypot(x - ax - k * dx, y - ay - k * dy);
}

const lengthOf = (points) => points.slice(1).reduce((metres, [x, y], k) => metres + Math.hypot(x - points[k][0], y - points[k][1]), 0);
const middleOf = (points) => (points.length > 2 ? points[Math.floor(points.length / 2)] : points[0].map((value, axis) => (value + points[1][axis]) / 2));
const bounds = (ring) => [0, 1].map((axis) => ring.map((point) => point[axis])).map((values) => [Math.min(...values), Math.max(...values)]).reduce(([west, east], [south, north]) => [west, south, east, north]);

// A sign in the middle of a line: a cross where it is left out, a 1 where it comes first, else the number of its tractor.
function mark(ctx, view, points, what) {
  const [px, py] = view.at(...middleOf(points));
  ctx.font = "700 13px system-ui, sans-serif";
  ctx.textAlign = "center";
  ctx.lineWidth = 4;
  ctx.strokeStyle = colours.halo;
  ctx.fillStyle = colours.ink;
  const words = what === "out" ? "\u00d7" : what === "first" ? "1." : String(what);
  ctx.strokeText(words, px, py + 4);
  ctx.fillText(words, px, py + 4);
}
