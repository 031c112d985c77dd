// How a field looks while it is drawn: its shapes, their points to be dragged, lengths of edges, a grid of metres.
import { colours } from "./palette.js";
import { polygon, line, hatch, marker, soil, edge, word } from "./layers.js";
import { GROUND } from "./legend.js";
import { KINDS } from "./shapes.js";
import { number } from "./words.js";

const GRAB_PX = 16, HANDLE_PX = 7, MIDDLE_PX = 4, LEAST_EDGE_PX = 64, NAMED_PX = 90;

/** The grid line in metres that the view has room for. */
export const gridStep = (view) => [1, 5, 10, 50, 100, 500].find((step) => step * view.scale > 24) ?? 1000;

export function grid(ctx, view) {
  const step = gridStep(view), [west, north] = view.place(0, 0), [east, south] = view.place(view.width, view.height);
  ctx.strokeStyle = colours.line;
  ctx.globalAlpha = 0.35;
  ctx.lineWidth = 1;
  ctx.beginPath();
  for (let at = Math.ceil(west / step) * step; at < east; at += step) { const [px] = view.at(at, 0); ctx.moveTo(px, 0); ctx.lineTo(px, view.height); }
  for (let at = Math.ceil(south / step) * step; at < north; at += step) { const [, py] = view.at(0, at); ctx.moveTo(0, py); ctx.lineTo(view.width, py); }
  ctx.stroke();
  ctx.globalAlpha = 1;
  line(ctx, view, [[0, south], [0, north]], colours.line, 1);
  line(ctx, view, [[west, 0], [east, 0]], colours.line, 1);
}

// Edges of a shape as pairs of its points; an area has one more, to its first point.
function edgesOf({ kind, points }) {
  const { form } = KINDS[kind];
  if (form === "point" || points.length < 2) return [];
  return points.slice(0, form === "area" && points.length > 2 ? points.length : -1).map((from, k) => [from, points[(k + 1) % points.length], k]);
}

const hasRoom = (view, [a, b]) => Math.hypot(b[0] - a[0], b[1] - a[1]) * view.scale > LEAST_EDGE_PX;

/** The point of a shape, or the middle of an edge of the chosen one, within a finger's width of a place; or null. */
export function handleAt(view, drawing, [x, y]) {
  const gap = ([u, v]) => Math.hypot(u - x, v - y) * view.scale;
  const found = drawing.shapes.flatMap(({ points }, shape) => points.map((one, point) => ({ shape, point, middle: false, gap: gap(one) - (shape === drawing.at.shape ? 4 : 0) })));
  if (drawing.chosen) for (const [a, b, point] of edgesOf(drawing.chosen)) {
    if (hasRoom(view, [a, b])) found.push({ shape: drawing.at.shape, point, middle: true, gap: gap([(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]) + 2 });
  }
  return found.filter((one) => one.gap < GRAB_PX).sort((a, b) => a.gap - b.gap)[0] ?? null;
}

const LOOKS = {
  fence: (ctx, view, { points }) => line(ctx, view, points, colours.ink, 3, [6, 3]),
  open: (ctx, view, { points }) => line(ctx, view, points, colours.good, 3, [2, 5]),
  guidance: (ctx, view, { points }) => line(ctx, view, points, colours.t4, 2, [10, 4, 2, 4]),
  headland: (ctx, view, { points }) => line(ctx, view, points, colours.soft, 1, [2, 3]),
  zone: (ctx, view, { points }) => polygon(ctx, view, [points], null, colours.t5, 1.5),
  area: (ctx, view, { points }) => obstacle(ctx, view, points),
  ditch: (ctx, view, { points, properties }) => line(ctx, view, points, colours.obstacle, Math.max(3, (properties.width_m ?? 1) * view.scale)),
  pole: (ctx, view, { points: [[x, y]], properties }) => {
    const [px, py] = view.at(x, y);
    ctx.beginPath();
    ctx.arc(px, py, Math.max(9, (properties.radius_m ?? 1) * view.scale), 0, 7);
    ctx.fillStyle = colours.obstacle;
    ctx.fill();
    ctx.lineWidth = 2;
    ctx.strokeStyle = colours.ink;
    ctx.stroke();
  },
  entrance: (ctx, view, { points: [at] }) => marker(ctx, view, at, "entrance"),
  refill: (ctx, view, { points: [at] }) => marker(ctx, view, at, "refill", true),
};

function obstacle(ctx, view, ring) {
  polygon(ctx, view, [ring], colours.obstacle, colours.edge, 1);
  hatch(ctx, view, [ring], colours.ink);
}

/** All shapes, with handles where they can be grabbed. */
export function shapeLayer(ctx, view, drawing) {
  const of = (kind) => drawing.shapes.filter((one) => one.kind === kind && one.points.length), rings = [...of("boundary"), ...of("hole")].map((one) => one.points);
  if (rings.length) { soil(ctx, view, rings); edge(ctx, view, rings, 2); }
  for (const hole of of("hole")) hatch(ctx, view, [hole.points], colours.ink);
  for (const shape of drawing.shapes) if (shape.points.length) LOOKS[shape.kind]?.(ctx, view, shape);
  for (const shape of drawing.shapes) if (["pole", "area", "ditch", "guidance"].includes(shape.kind) && shape.properties.name) {
    const [px, py] = view.at(...shape.points[0]);
    word(ctx, px, py - 16, shape.properties.name, colours.ink);
  }
  drawing.shapes.forEach((shape, s) => handles(ctx, view, shape, s === drawing.at.shape, drawing.at.point));
}

function handles(ctx, view, shape, isChosen, chosenPoint) {
  const dot = (px, py, radius, fill, rim) => { ctx.beginPath(); ctx.arc(px, py, radius, 0, 7); ctx.fillStyle = fill; ctx.fill(); ctx.strokeStyle = rim; ctx.lineWidth = 2; ctx.stroke(); };
  for (const [a, b] of edgesOf(shape)) {
    const [px, py] = view.at((a[0] + b[0]) / 2, (a[1] + b[1]) / 2), length = Math.hypot(b[0] - a[0], b[1] - a[1]);
    if (isChosen && hasRoom(view, [a, b])) dot(px, py, MIDDLE_PX, colours.panel, colours.soft);
    if (shape.kind === "boundary" && length * view.scale > NAMED_PX) word(ctx, px, py - 12, number(length, 0, "m"), colours.ink);
  }
  shape.points.forEach((point, k) => {
    const [px, py] = view.at(...point), isPoint = isChosen && k === chosenPoint;
    dot(px, py, isPoint ? HANDLE_PX + 2 : isChosen ? HANDLE_PX : HANDLE_PX - 3, isPoint ? colours.accent : colours.panel, isChosen ? colours.accent : colours.edge);
  });
}

const ENTRIES = {
  boundary: GROUND.edge,
  hole: [{ hatch: "ink" }, "hole"],
  pole: GROUND.pole, area: GROUND.obstacle, ditch: GROUND.obstacle,
  entrance: GROUND.entrance,
  refill: GROUND.refill,
  fence: GROUND.fence,
  open: [{ line: "good", width: 3, dash: "2 5" }, "dotted, thick: open edge"],
  guidance: GROUND.guidance,
  headland: [{ line: "soft", width: 1, dash: "2 3" }, "dotted: edge of a headland"],
  zone: [{ line: "t5", width: 1.5 }, "ground of its own"],
};

/** Legend entries of what is drawn. */
export const drawnEntries = (shapes) => [...new Set(["boundary", ...shapes.map((one) => one.kind)].map((kind) => ENTRIES[kind]))];
