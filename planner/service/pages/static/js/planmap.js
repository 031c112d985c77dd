// One plan on the map, played back: ground, numbered tracks, paths, and the ground worked so far.
import { el, put, say, who } from "./dom.js";
import { MapView } from "./map.js";
import { Player, poseAt, before } from "./player.js";
import { colours } from "./palette.js";
import { polygon, line, hatch, contours, tractor, trackNames, soil, edge, marker } from "./layers.js";
import { mapLegend, planEntries } from "./legend.js";

const DOING = ["done", "working", "turning", "waiting", "reversing", "refilling", "folding"];

export class PlanMap {
  constructor() {
    this.view = new MapView("Map of the plan", { short: false });
    this.view.layers = [(ctx, view) => this.plan && this.draw(ctx, view)];
    this.under = el("div", { class: "under" });
    this.node = el("div", { class: "panel flush" }, this.view.node, this.under);
  }

  /** Show a plan as maps.json has it. */
  show(plan) {
    this.player?.close();
    this.rows = null;
    this.plan = plan;
    this.parts = plan.lanes.map(segments);
    this.player = new Player({ end: plan.end_s, moved: () => { this.view.redraw(); this.tell(); } });
    this.rows = plan.lanes.map((lane, n) => ({ words: el("span", { class: "small" }), n }));
    put(this.under, this.player.node, el("ul", { class: "legend", "aria-label": "Tractors" }, this.rows.map(({ words, n }) => el("li", {}, who(n + 1), words))), mapLegend(planEntries(plan)));
    const all = [...plan.boundary_m, ...plan.lanes.flatMap((lane) => lane.points_m)];
    const box = [0, 1].map((k) => Math.min(...all.map((p) => p[k]))).concat([0, 1].map((k) => Math.max(...all.map((p) => p[k]))));
    this.view.fit(box);
    this.view.setGrounds([{ crs: plan.crs, origin: plan.origin_m ?? [0, 0], box }]);
    this.tell();
  }

  tell() {
    if (!this.rows) return;
    const now = this.player.now;
    this.rows.forEach(({ words, n }) => {
      const lane = this.plan.lanes[n], step = (lane.steps ?? []).find((one) => now >= one.from_s && now < one.from_s + one.seconds);
      say(words, now <= 0 ? "at the start" : now >= lane.time_s[lane.time_s.length - 1] ? "done" : step?.words ?? DOING[poseAt(lane, now).status] ?? "");
    });
  }

  draw(ctx, view) {
    const plan = this.plan, now = this.player.now, thick = Math.max(1, plan.width_m * view.scale);
    soil(ctx, view, [plan.boundary_m, ...plan.holes_m]);
    if (plan.relief) contours(ctx, view, [plan.boundary_m, ...plan.holes_m], plan.relief.contours_m);
    ctx.save();
    ctx.globalAlpha = 0.4;
    this.parts.forEach((parts, n) => parts.filter((part) => part.status === 1 && part.from < now).forEach((part) => {
      line(ctx, view, upTo(plan.lanes[n], part, now), colours.tractor(n + 1), thick);
    }));
    ctx.restore();
    for (const track of plan.swaths) line(ctx, view, track.points_m, colours.swath, 1);
    for (const ring of plan.obstacles_m) polygon(ctx, view, [ring], colours.obstacle);
    if (plan.missed_m.length) hatch(ctx, view, plan.missed_m, colours.off);
    edge(ctx, view, [plan.boundary_m, ...plan.holes_m]);
    for (const fence of plan.fences_m) line(ctx, view, fence, colours.ink, 3, [6, 3]);
    this.parts.forEach((parts, n) => {
      ctx.globalAlpha = 0.55;
      parts.forEach((part) => line(ctx, view, part.points, colours.tractor(n + 1), part.status === 1 ? 1.8 : 1, part.status === 4 ? [2, 3] : []));
    });
    ctx.globalAlpha = 1;
    if (plan.entrance_m) marker(ctx, view, plan.entrance_m, "");
    trackNames(ctx, view, plan.swaths, plan.headland_passes);
    plan.lanes.forEach((lane, n) => tractor(ctx, view, poseAt(lane, now), n + 1, { width: plan.width_m }));
  }

  close() {
    this.player?.close();
    this.view.close();
  }
}

// Segments of one status each; standing still gives none.
function segments(lane) {
  const parts = [];
  for (let k = 0; k < lane.status.length; k++) {
    const last = parts[parts.length - 1];
    if (last && last.status === lane.status[k]) { last.points.push(lane.points_m[k + 1]); last.last = k + 1; }
    else parts.push({ status: lane.status[k], points: [lane.points_m[k], lane.points_m[k + 1]], first: k, last: k + 1, from: lane.time_s[k] });
  }
  return parts;
}

function upTo(lane, part, now) {
  if (now >= lane.time_s[part.last]) return part.points;
  const at = before(lane.time_s, now), pose = poseAt(lane, now);
  return [...lane.points_m.slice(part.first, at + 1), [pose.x, pose.y]];
}
