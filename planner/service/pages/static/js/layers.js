// What maps are made of: rings, lines, tractors, numbers. All places are metres, turned into pixels by the view.
import { colours } from "./palette.js";

const TURN = Math.PI / 180;

export function trace(ctx, view, points, closed = false) {
  points.forEach(([x, y], k) => {
    const [px, py] = view.at(x, y);
    if (k) ctx.lineTo(px, py); else ctx.moveTo(px, py);
  });
  if (closed) ctx.closePath();
}

export function polygon(ctx, view, rings, fill, stroke = null, width = 1.5) {
  ctx.beginPath();
  rings.forEach((ring) => trace(ctx, view, ring, true));
  if (fill) { ctx.fillStyle = fill; ctx.fill("evenodd"); }
  if (stroke) { ctx.strokeStyle = stroke; ctx.lineWidth = width; ctx.stroke(); }
}

/** The ground of a field; over a background only a breath of its colour. */
export function soil(ctx, view, rings) {
  ctx.globalAlpha = view.backed ? 0.3 : 1;
  polygon(ctx, view, rings, colours.field);
  ctx.globalAlpha = 1;
}

/** The edge of a field, pale beside it where a background lies below. */
export function edge(ctx, view, rings, width = 1.5) {
  if (view.backed) polygon(ctx, view, rings, null, colours.halo, width + 3);
  polygon(ctx, view, rings, null, colours.edge, width);
}

/** A place with a word: an entrance is a triangle that points at it, a refill place a diamond. */
export function marker(ctx, view, [x, y], text, isRefill = false) {
  const [px, py] = view.at(x, y);
  ctx.beginPath();
  ctx.moveTo(px, py); ctx.lineTo(px - 7, py - (isRefill ? 8 : 14));
  if (isRefill) ctx.lineTo(px, py - 16);
  ctx.lineTo(px + 7, py - (isRefill ? 8 : 14)); ctx.closePath();
  ctx.lineWidth = 3;
  ctx.strokeStyle = colours.halo;
  ctx.stroke();
  ctx.fillStyle = colours.ink;
  ctx.fill();
  if (text) word(ctx, px, py - 23, text, colours.ink);
}

export function line(ctx, view, points, stroke, width = 1.5, dash = []) {
  if (points.length < 2) return;
  ctx.beginPath();
  trace(ctx, view, points);
  ctx.strokeStyle = stroke;
  ctx.lineWidth = width;
  ctx.lineJoin = "round";
  ctx.setLineDash(dash);
  ctx.stroke();
  ctx.setLineDash([]);
}

/** Lines of equal height inside rings. */
export function contours(ctx, view, rings, lines) {
  ctx.save();
  ctx.beginPath();
  rings.forEach((ring) => trace(ctx, view, ring, true));
  ctx.clip("evenodd");
  ctx.globalAlpha = 0.7;
  for (const one of lines) line(ctx, view, one, colours.soft, 1);
  ctx.restore();
}

/** Lines at 45 degrees over rings: unworked ground, and places where nobody may drive. */
export function hatch(ctx, view, rings, stroke) {
  ctx.save();
  ctx.beginPath();
  rings.forEach((ring) => trace(ctx, view, ring, true));
  ctx.clip("evenodd");
  ctx.strokeStyle = stroke;
  ctx.lineWidth = 1;
  ctx.beginPath();
  for (let x = -view.height; x < view.width; x += 7) { ctx.moveTo(x, 0); ctx.lineTo(x + view.height, view.height); }
  ctx.stroke();
  ctx.restore();
}

/** A word with a pale edge, in the middle of a place. */
export function word(ctx, px, py, text, colour, font = "600 12px system-ui, sans-serif") {
  ctx.font = font;
  ctx.textAlign = "center";
  ctx.textBaseline = "middle";
  // Near the side of the map it is moved in, so that none of it is cut off.
  const wide = ctx.canvas.width / (window.devicePixelRatio || 1), half = Math.min(ctx.measureText(text).width / 2 + 3, wide / 2);
  if (px > 0 && px < wide) px = Math.min(Math.max(px, half), wide - half);
  ctx.lineWidth = 3;
  ctx.lineJoin = "round";
  ctx.strokeStyle = colours.halo;
  ctx.strokeText(text, px, py);
  ctx.fillStyle = colour;
  ctx.fillText(text, px, py);
  ctx.textBaseline = "alphabetic";
}

/** A tractor: a body as large as it is, or as must be seen, its direction and number; hollow where it was last. */
export function tractor(ctx, view, pose, number, { hollow = false, ghost = false, chosen = false, width = 3 } = {}) {
  const [px, py] = view.at(pose.x, pose.y), colour = colours.tractor(number);
  const size = Math.max(9, Math.min(2.2 * view.scale, 26));
  ctx.save();
  ctx.translate(px, py);
  ctx.rotate(pose.heading * TURN);
  if (!ghost && width * view.scale > 14) {
    ctx.strokeStyle = colour;
    ctx.lineWidth = 3;
    ctx.beginPath(); ctx.moveTo((-width / 2) * view.scale, size); ctx.lineTo((width / 2) * view.scale, size); ctx.stroke();
  }
  ctx.beginPath();
  ctx.moveTo(0, -1.75 * size); ctx.lineTo(size, -0.4 * size); ctx.lineTo(size, size); ctx.lineTo(-size, size); ctx.lineTo(-size, -0.4 * size);
  ctx.closePath();
  ctx.lineWidth = ghost ? 1.5 : 2;
  if (ghost) { ctx.setLineDash([4, 3]); ctx.strokeStyle = colours.ink; ctx.stroke(); ctx.restore(); return; }
  ctx.fillStyle = hollow ? colours.halo : colour;
  ctx.strokeStyle = hollow ? colour : colours.halo;
  if (hollow) ctx.setLineDash([4, 3]);
  ctx.fill();
  ctx.stroke();
  ctx.restore();
  if (chosen) { ctx.beginPath(); ctx.arc(px, py, 2.1 * size, 0, 7); ctx.strokeStyle = colour; ctx.lineWidth = 2; ctx.stroke(); }
  ctx.font = "750 12px system-ui, sans-serif";
  ctx.textAlign = "center";
  ctx.textBaseline = "middle";
  ctx.fillStyle = hollow ? colour : colours.halo;
  ctx.fillText(String(number), px, py);
  ctx.textBaseline = "alphabetic";
}

/** Numbers of tracks beyond their ends, and names of sides of the headland in their middle, where they have room. */
export function trackNames(ctx, view, tracks, sides = []) {
  const taken = [], isTaken = (at) => taken.some((one) => Math.hypot(one[0] - at[0], one[1] - at[1]) < 17);
  const write = (at, name) => {
    taken.push(at);
    word(ctx, ...at, name, colours.soft, "600 11px system-ui, sans-serif");
  };
  for (const { name, points_m: points } of tracks) {
    for (const [end, other] of [[points[points.length - 1], points[0]], [points[0], points[points.length - 1]]]) {
      const length = Math.hypot(end[0] - other[0], end[1] - other[1]) || 1;
      const [px, py] = view.at(end[0], end[1]);
      const at = [px + ((end[0] - other[0]) / length) * 11, py - ((end[1] - other[1]) / length) * 11];
      if (!isTaken(at)) write(at, name);
    }
  }
  for (const { name, points_m: points } of sides) {
    const middle = points.length >> 1, [a, b] = [points[middle - 1], points[middle]];
    const at = view.at((a[0] + b[0]) / 2, (a[1] + b[1]) / 2);
    if (!isTaken(at)) write(at, name);
  }
}
