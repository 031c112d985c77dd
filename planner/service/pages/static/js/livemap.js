// Fleets on one map: ground, worked ground, plan against actual, twins, tractors. Fields that are far apart, or have
// no coordinates on the earth, are drawn beside each other, each to scale.
import { MapView } from "./map.js";
import { t } from "./language.js";
import { colours, onColours } from "./palette.js";
import { boxOf } from "./fleetlive.js";
import { linkCover } from "./stale.js";
import { span } from "./words.js";
import { polygon, line, hatch, tractor, word, soil, edge } from "./layers.js";

const REMADE_MS = 400, FRAME_MS = 30, CALM_MS = 250, APART_PX = 6, NEAR_M = 2000, GROUND_M = 150;

// Fleets whose metres are of the same grid; local metres are a grid of their own.
const gridOf = (live) => live.scene.crs ?? `local ${live.id}`;

/** Where fields go on one map, from [{grid, box}] with boxes in metres of their grids: [{group, shift: [x, y]}].

Those of a grid at most NEAR_M apart are one group and keep their distances; groups stand in rows beside each other. The
first field stays where it is. */
export function arranged(fields) {
  const groups = [];
  for (const one of fields) {
    const near = groups.filter((group) => group.some((other) => other.grid === one.grid && gap(other.box, one.box) <= NEAR_M));
    for (const group of near) groups.splice(groups.indexOf(group), 1);
    groups.push([...near.flat(), one]);
  }
  groups.sort((a, b) => Math.min(...a.map((one) => fields.indexOf(one))) - Math.min(...b.map((one) => fields.indexOf(one))));
  const boxes = groups.map((group) => around(group.map((one) => one.box)));
  const apart = 0.15 * Math.max(...boxes.map((box) => Math.max(box[2] - box[0], box[3] - box[1])));
  const widest = Math.max(...boxes.map((box) => box[2] - box[0]), 1.4 * Math.sqrt(boxes.reduce((sum, box) => sum + (box[2] - box[0] + apart) * (box[3] - box[1] + apart), 0)));
  const found = new Map();
  let x = 0, top = 0, low = 0, first = null;
  groups.forEach((group, k) => {
    const [west, south, east, north] = boxes[k];
    if (x > 0 && x + east - west > widest) { x = 0; top = low - apart; low = top; }
    const shift = [x - west, top - north];
    first ??= shift;
    for (const one of group) found.set(one, { group: k, shift: [shift[0] - first[0], shift[1] - first[1]] });
    x += east - west + apart;
    low = Math.min(low, top - (north - south));
  });
  return fields.map((one) => found.get(one));
}

const around = (boxes) => [0, 1, 2, 3].map((k) => (k < 2 ? Math.min : Math.max)(...boxes.map((box) => box[k])));
const gap = (a, b) => Math.hypot(Math.max(a[0] - b[2], b[0] - a[2], 0), Math.max(a[1] - b[3], b[1] - a[3], 0));

export class LiveMap {
  constructor(label, { lives, chosen = () => null, short = false, follow = () => false }) {
    this.view = new MapView(label, { short });
    Object.assign(this, { lives, chosen, follow, node: this.view.node, extra: null, only: null, layout: { key: "", at: new Map() } });
    this.view.layers = [(ctx) => this.draw(ctx)];
    this.base = document.createElement("canvas");
    this.cover = linkCover(lives);
    this.node.append(this.cover.node);
    this.forget = onColours(() => { this.key = ""; for (const live of this.lives()) live.coverage.again(); });
    // With reduced motion in the system's settings tractors move in steps.
    const calm = matchMedia("(prefers-reduced-motion: reduce)");
    let last = 0;
    const animate = (stamp = 0) => {
      this.frame = requestAnimationFrame(animate);
      if (stamp - last < (calm.matches ? CALM_MS : FRAME_MS)) return;
      last = stamp;
      this.step();
    };
    animate();
  }

  // Redraw every frame while a fleet is online; else once, to show that it is not.
  step() {
    const shown = this.shown(), linked = shown.some((live) => live.link === "online");
    this.cover.update();
    if (linked || this.linked) {
      const follow = this.follow();
      if (follow) {
        const pose = follow.live.pose(follow.number);
        if (pose) { const [dx, dy] = this.shift(follow.live); this.view.centre(pose.x + dx, pose.y + dy); }
      }
      this.view.draw();
    }
    this.linked = linked;
  }

  shown() {
    return this.lives().filter((live) => live.scene);
  }

  // The place of every fleet on the map; computed again with every new scene.
  places() {
    const shown = this.shown(), key = shown.map((live) => `${live.id} ${live.scenes}`).join("\n");
    if (key === this.layout.key) return this.layout.at;
    const boxes = shown.map((live) => boxOf(live.scene));
    const there = arranged(shown.map((live, k) => ({ grid: gridOf(live), box: moved(boxes[k], live.origin) })));
    const at = new Map(shown.map((live, k) => {
      const [east, north] = [0, 1].map((n) => live.origin[n] - shown[0].origin[n] + there[k].shift[n]);
      return [live, { group: there[k].group, shift: [east, north], box: moved(boxes[k], [east, north]) }];
    }));
    this.layout = { key, at };
    // In metres of each fleet; some ground round the field is seen too.
    this.view.setGrounds(shown.map((live, k) => ({ crs: live.scene.crs, origin: live.origin, box: grown(boxes[k], GROUND_M), shift: at.get(live).shift })));
    return at;
  }

  // Metres of a fleet to those of the map, whose origin is that of the first fleet shown.
  shift(live) { return this.places().get(live).shift; }

  /** Names of the fields that stand apart from each other, one for each group. */
  groups() {
    const names = [];
    for (const [live, { group }] of this.places()) names[group] = [...(names[group] ?? []), live.name];
    return names;
  }

  /** Show all fields, or those of the group `only`. */
  fit() {
    const boxes = [...this.places().values()].filter((one) => this.only === null || one.group === this.only).map((one) => one.box);
    if (boxes.length) this.view.fit(around(boxes));
  }

  // The view as a fleet has it, whose metres are counted from an origin of its own.
  viewOf(live) {
    const [dx, dy] = this.shift(live), place = (px, py) => { const [x, y] = this.view.place(px, py); return [x - dx, y - dy]; };
    return Object.create(this.view, { at: { value: (x, y) => this.view.at(x + dx, y + dy) }, place: { value: place } });
  }

  // Ground and plans are drawn when the view changes and a few times a second; what moves is drawn over them.
  draw(ctx) {
    const { x, y, scale, width, height } = this.view, key = `${x} ${y} ${scale} ${width} ${height} ${this.layout.key}`, now = performance.now();
    if (key !== this.key || now - this.made > REMADE_MS) {
      this.key = key;
      this.made = now;
      this.drawBase();
    }
    ctx.drawImage(this.base, 0, 0, width, height);
    for (const live of this.shown()) {
      const view = this.viewOf(live);
      this.extra?.(ctx, view, live);
      for (const number of live.numbers()) drawArea(ctx, view, live, number);
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
    if (this.places().size > 1) for (const [live, { box }] of this.places()) {
      const [px, py] = this.view.at((box[0] + box[2]) / 2, box[3]);
      word(ctx, px, py - 9, live.name, colours.ink);
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

const grown = ([west, south, east, north], by) => [west - by, south - by, east + by, north + by];
const moved = (box, [x, y]) => [box[0] + x, box[1] + y, box[2] + x, box[3] + y];

export function drawGround(ctx, view, scene, between = null) {
  soil(ctx, view, scene.rings);
  between?.(ctx);
  if (scene.obstacles?.length) {
    for (const ring of scene.obstacles) polygon(ctx, view, [ring], colours.obstacle, colours.edge, 1);
    hatch(ctx, view, scene.obstacles, colours.ink);
  }
  edge(ctx, view, scene.rings);
  for (const ring of scene.fence ?? []) line(ctx, view, [...ring, ring[0]], colours.line, 1, [2, 6]);
}

// The plan of one tractor: horizon legs faint and dashed, base legs strong; driven ones are worked ground.
function drawPlan(ctx, view, live, number, chosen) {
  const legs = live.scene.lanes[number - 1] ?? [], fix = live.fixes.get(number);
  const colour = colours.tractor(number), at = fix?.leg ?? 0, released = fix?.base_end ?? 0;
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

// Where a tractor in doubt may be, as it grows between two ticks.
function drawArea(ctx, view, live, number) {
  const fix = live.fixes.get(number), area = fix?.possible_area;
  if (!area) return;
  const [px, py] = view.at(area.easting_m - live.origin[0], area.northing_m - live.origin[1]);
  ctx.beginPath();
  ctx.arc(px, py, (area.radius_m + (area.growth_mps * (performance.now() - fix.heard)) / 1000) * view.scale, 0, 2 * Math.PI);
  ctx.globalAlpha = 0.16;
  ctx.fillStyle = colours.off;
  ctx.fill();
  ctx.globalAlpha = 1;
  ctx.strokeStyle = colours.off;
  ctx.lineWidth = 2;
  ctx.setLineDash([8, 5]);
  ctx.stroke();
  ctx.setLineDash([]);
  word(ctx, px, py - 26, t`tractor ${number} may be in here`, colours.off);
}

function drawTractor(ctx, view, live, number, chosen) {
  const pose = live.pose(number), twin = live.twin(number);
  if (!pose) return;
  const fix = pose.fix, width = live.scene.width;
  for (const wait of fix.waits_for ?? []) {
    const other = live.pose(wait.tractor);
    if (other) line(ctx, view, [[pose.x, pose.y], [other.x, other.y]], colours.warn, 2, [2, 5]);
  }
  tractor(ctx, view, pose, number, { hollow: fix.connection !== "online" || live.isOld(number), chosen, width });
  if (twin && (chosen || Math.hypot(twin.x - pose.x, twin.y - pose.y) * view.scale > APART_PX)) tractor(ctx, view, twin, number, { ghost: true });
  if (fix.connection !== "online" || live.isOld(number)) {
    const [px, py] = view.at(pose.x, pose.y), old = live.age(number);
    const words = fix.connection === "broken" ? "connection broken" : fix.connection === "online" ? "last here" : "offline, last here";
    word(ctx, px, py + 26, old === null ? words : t`${words}, ${span(old)} ago`, colours.off);
  }
}
