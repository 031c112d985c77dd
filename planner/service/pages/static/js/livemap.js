// Fleets on one map: ground, worked ground, plan against actual, twins, tractors. Fleets of one grid share the map.
import { MapView } from "./map.js";
import { colours, onColours } from "./palette.js";
import { boxOf } from "./fleetlive.js";
import { polygon, line, hatch, tractor, word } from "./layers.js";

const REMADE_MS = 400, FRAME_MS = 30, CALM_MS = 250, APART_PX = 6;

/** Fleets whose metres are of the same grid; local metres are a grid of their own. */
export const gridOf = (live) => live.scene?.crs ?? `local ${live.id}`;

export class LiveMap {
  constructor(label, { lives, chosen = () => null, short = false, follow = () => false }) {
    this.view = new MapView(label, { short });
    Object.assign(this, { lives, chosen, follow, node: this.view.node, grid: null, extra: null });
    this.view.layers = [(ctx) => this.draw(ctx)];
    this.base = document.createElement("canvas");
    this.forget = onColours(() => { this.key = ""; for (const live of this.lives()) live.coverage.again(); });
    // Who asked the system for little motion gets steps instead of gliding.
    const calm = matchMedia("(prefers-reduced-motion: reduce)");
    let last = 0;
    const beat = (stamp = 0) => {
      this.frame = requestAnimationFrame(beat);
      if (stamp - last < (calm.matches ? CALM_MS : FRAME_MS)) return;
      last = stamp;
      this.step();
    };
    beat();
  }

  // Every frame where something moves; nothing while all stand.
  step() {
    const shown = this.shown();
    if (shown.some((live) => live.link === "online")) {
      const follow = this.follow();
      if (follow) {
        const pose = follow.live.pose(follow.number);
        if (pose) { const [dx, dy] = this.shift(follow.live); this.view.centre(pose.x + dx, pose.y + dy); }
      }
      this.view.draw();
    }
  }

  shown() {
    const all = this.lives().filter((live) => live.scene);
    if (!all.some((live) => gridOf(live) === this.grid)) this.grid = all[0] ? gridOf(all[0]) : null;
    return all.filter((live) => gridOf(live) === this.grid);
  }

  // Metres of a fleet to those of the map, whose origin is that of the first fleet shown.
  shift(live) {
    const first = this.shown()[0];
    return [live.origin[0] - first.origin[0], live.origin[1] - first.origin[1]];
  }

  fit() {
    const boxes = this.shown().map((live) => {
      const [dx, dy] = this.shift(live), box = boxOf(live.scene);
      return [box[0] + dx, box[1] + dy, box[2] + dx, box[3] + dy];
    });
    if (!boxes.length) return;
    this.view.fit([0, 1, 2, 3].map((k) => (k < 2 ? Math.min : Math.max)(...boxes.map((box) => box[k]))));
  }

  // The view as a fleet has it, whose metres are counted from an origin of its own.
  viewOf(live) {
    const [dx, dy] = this.shift(live), place = (px, py) => { const [x, y] = this.view.place(px, py); return [x - dx, y - dy]; };
    return Object.create(this.view, { at: { value: (x, y) => this.view.at(x + dx, y + dy) }, place: { value: place } });
  }

  // Ground and plans are drawn when the view changes and a few times a second; what moves is drawn over them.
  draw(ctx) {
    const { x, y, scale, width, height } = this.view, key = `${x} ${y} ${scale} ${width} ${height} ${this.grid}`, now = performance.now();
    if (key !== this.key || now - this.made > REMADE_MS) {
      this.key = key;
      this.made = now;
      this.drawBase();
    }
    ctx.drawImage(this.base, 0, 0, width, height);
    for (const live of this.shown()) {
      const view = this.viewOf(live);
      this.extra?.(ctx, view, live);
      for (const number of live.numbers()) drawTractor(ctx, view, live, number, this.isChosen(live, number));
    }
  }

  drawBase() {
    const ratio = window.devicePixelRatio || 1, { width, height } = this.view;
    this.base.width = Math.round(width * ratio);
    this.base.height = Math.round(height * ratio);
    const ctx = this.base.getContext("2d");
    ctx.scale(ratio, ratio);
    for (const live of this.shown()) {
      const view = this.viewOf(live);
      drawGround(ctx, view, live.scene, (inner) => live.coverage.draw(inner, view));
      for (const number of live.numbers()) drawPlan(ctx, view, live, number, this.isChosen(live, number));
    }
  }

  isChosen(live, number) {
    const chosen = this.chosen();
    return chosen?.live === live && chosen.number === number;
  }

  /** The tractor nearest to a place of the map, within a finger's width. */
  nearest([x, y]) {
    let best = null, least = 24 / this.view.scale;
    for (const live of this.shown()) for (const number of live.numbers()) {
      const pose = live.pose(number), [dx, dy] = this.shift(live);
      const gap = pose ? Math.hypot(pose.x + dx - x, pose.y + dy - y) : Infinity;
      if (gap < least) { least = gap; best = { live, number }; }
    }
    return best;
  }

  close() {
    cancelAnimationFrame(this.frame);
    this.forget();
    this.view.close();
  }
}

export function drawGround(ctx, view, scene, between = null) {
  polygon(ctx, view, scene.rings, colours.field);
  between?.(ctx);
  if (scene.obstacles?.length) {
    for (const ring of scene.obstacles) polygon(ctx, view, [ring], colours.obstacle, colours.edge, 1);
    hatch(ctx, view, scene.obstacles, colours.ink);
  }
  polygon(ctx, view, scene.rings, null, colours.edge, 1.5);
  for (const ring of scene.fence ?? []) line(ctx, view, [...ring, ring[0]], colours.line, 1, [2, 6]);
}

// The plan of one tractor: announced legs faint and dashed, released ones strong; what is driven is painted ground.
function drawPlan(ctx, view, live, number, chosen) {
  const legs = live.scene.lanes[number - 1] ?? [], fix = live.fixes.get(number);
  const colour = colours.tractor(number), at = fix?.leg ?? 0, released = fix?.released ?? 0;
  const [west, north] = view.place(0, 0), [east, south] = view.place(view.width, view.height);
  const seen = ({ box }) => box[0] < east && box[2] > west && box[1] < north && box[3] > south;
  ctx.globalAlpha = chosen ? 0.8 : 0.42;
  legs.forEach((leg, k) => {
    if (k >= Math.max(released, at) && seen(leg)) line(ctx, view, leg.points, colour, leg.implement ? 1.3 : 0.8, leg.implement ? [] : [3, 3]);
  });
  ctx.globalAlpha = 1;
  legs.slice(at, released).forEach((leg) => line(ctx, view, leg.points, colour, leg.implement ? 4 : 2.5));
  if (chosen) line(ctx, view, live.trails.get(number) ?? [], colours.ink, 1.2);
}

function drawTractor(ctx, view, live, number, chosen) {
  const pose = live.pose(number), twin = live.twin(number);
  if (!pose) return;
  const fix = pose.fix, width = live.scene.width;
  for (const wait of fix.waits_for ?? []) {
    const other = live.pose(wait.tractor);
    if (other) line(ctx, view, [[pose.x, pose.y], [other.x, other.y]], colours.warn, 2, [2, 5]);
  }
  tractor(ctx, view, pose, number, { hollow: fix.connection !== "online" || live.link !== "online", chosen, width });
  if (twin && (chosen || Math.hypot(twin.x - pose.x, twin.y - pose.y) * view.scale > APART_PX)) tractor(ctx, view, twin, number, { ghost: true });
  if (fix.connection !== "online") {
    const [px, py] = view.at(pose.x, pose.y);
    word(ctx, px, py + 26, fix.connection === "broken" ? "connection broken" : "offline, last here", colours.off);
  }
}
