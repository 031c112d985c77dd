// The view of a camera above the cab, drawn in perspective from the map: ground, lines, obstacles, other tractors.
import { el } from "./dom.js";
import { colours, onColours } from "./palette.js";

const HEIGHT_M = 3.2, TILT = 11, FIELD_OF_VIEW = 62, NEAR_M = 0.6, FAR_M = 160, RAD = Math.PI / 180;
const POLE_M = 1.6, BODY_M = 2.4;

export class Camera {
  constructor(label) {
    this.node = el("canvas", { class: "camera", role: "img", "aria-label": label });
    this.forget = onColours(() => {});
  }

  /** `scene` has rings and obstacles in metres, `lines` are {points, colour, width}, `others` {x, y, heading, number}. */
  draw(pose, scene, lines, others) {
    const { clientWidth: width, clientHeight: height } = this.node;
    if (!width || !pose) return;
    const ratio = window.devicePixelRatio || 1, ctx = this.node.getContext("2d");
    this.node.width = Math.round(width * ratio);
    this.node.height = Math.round(height * ratio);
    ctx.scale(ratio, ratio);
    this.aim(pose, width, height);
    const horizon = height / 2 - this.focus * Math.tan(TILT * RAD);
    ctx.fillStyle = colours.sky;
    ctx.fillRect(0, 0, width, height);
    ctx.fillStyle = colours.ground;
    ctx.fillRect(0, horizon, width, height - horizon);
    for (const ring of scene.rings.slice(0, 1)) this.face(ctx, ring.map(([x, y]) => this.see(x, y, 0)), colours.field, colours.edge);
    for (const ring of scene.rings.slice(1)) this.face(ctx, ring.map(([x, y]) => this.see(x, y, 0)), colours.ground, colours.edge);
    for (const one of lines) this.path(ctx, one);
    for (const ring of scene.obstacles ?? []) this.block(ctx, ring, 0, POLE_M, colours.obstacle);
    const far = (one) => -((one.x - pose.x) ** 2 + (one.y - pose.y) ** 2);
    for (const one of [...others].sort((a, b) => far(a) - far(b))) this.body(ctx, one);
  }

  aim(pose, width, height) {
    this.x = pose.x;
    this.y = pose.y;
    this.sin = Math.sin(pose.heading * RAD);
    this.cos = Math.cos(pose.heading * RAD);
    this.middle = [width / 2, height / 2];
    this.focus = Math.max(width, height) / 2 / Math.tan((FIELD_OF_VIEW / 2) * RAD);
  }

  // A place in the camera's frame: right, up and ahead.
  see(x, y, z) {
    const [dx, dy] = [x - this.x, y - this.y];
    const ahead = dx * this.sin + dy * this.cos, right = dx * this.cos - dy * this.sin, up = z - HEIGHT_M;
    const [s, c] = [Math.sin(TILT * RAD), Math.cos(TILT * RAD)];
    return [right, up * c + ahead * s, ahead * c - up * s];
  }

  pixel([right, up, ahead]) {
    return [this.middle[0] + (this.focus * right) / ahead, this.middle[1] - (this.focus * up) / ahead];
  }

  // Clip points behind the camera (Sutherland and Hodgman 1974, against one plane).
  clip(points, closed) {
    const kept = [];
    points.forEach((now, k) => {
      const before = points[(k + points.length - 1) % points.length];
      const crosses = (closed || k > 0) && (now[2] > NEAR_M) !== (before[2] > NEAR_M);
      if (crosses) {
        const share = (NEAR_M - before[2]) / (now[2] - before[2]);
        kept.push([0, 1, 2].map((i) => (i === 2 ? NEAR_M : before[i] + share * (now[i] - before[i]))));
      }
      if (now[2] > NEAR_M) kept.push(now);
    });
    return kept;
  }

  face(ctx, points, fill, stroke = null) {
    const seen = this.clip(points, true);
    if (seen.length < 3) return;
    ctx.beginPath();
    seen.forEach((point, k) => (k ? ctx.lineTo(...this.pixel(point)) : ctx.moveTo(...this.pixel(point))));
    ctx.closePath();
    ctx.fillStyle = fill;
    ctx.fill();
    if (stroke) { ctx.strokeStyle = stroke; ctx.lineWidth = 1.2; ctx.stroke(); }
  }

  // A line, or where `strip_m` is given the ground half as far to both sides of it.
  path(ctx, { points, colour, width = 2, alpha = 1, strip_m = 0 }) {
    ctx.globalAlpha = alpha;
    ctx.strokeStyle = colour;
    ctx.lineWidth = width;
    for (const run of this.near(points)) {
      if (strip_m) { this.face(ctx, ribbon(run, strip_m).map(([x, y]) => this.see(x, y, 0)), colour); continue; }
      const places = run.map(([x, y]) => this.see(x, y, 0.02));
      ctx.beginPath();
      for (let k = 1; k < places.length; k++) {
        const seen = this.clip(places.slice(k - 1, k + 1), false);
        if (seen.length < 2) continue;
        ctx.moveTo(...this.pixel(seen[0]));
        ctx.lineTo(...this.pixel(seen[1]));
      }
      ctx.stroke();
    }
    ctx.globalAlpha = 1;
  }

  // Runs of points whose segments are near enough to be visible.
  near(points) {
    const runs = [];
    let run = null;
    for (let k = 1; k < points.length; k++) {
      if (away(points[k - 1], points[k], this.x, this.y) > FAR_M) { run = null; continue; }
      if (!run) runs.push((run = [points[k - 1]]));
      run.push(points[k]);
    }
    return runs;
  }

  // Walls from the farthest to the nearest, then the top.
  block(ctx, ring, low, high, colour) {
    const walls = ring.map((a, k) => [a, ring[(k + 1) % ring.length]]);
    const away = ([a, b]) => Math.hypot((a[0] + b[0]) / 2 - this.x, (a[1] + b[1]) / 2 - this.y);
    walls.sort((a, b) => away(b) - away(a));
    for (const [a, b] of walls) this.face(ctx, [this.see(...a, low), this.see(...b, low), this.see(...b, high), this.see(...a, high)], colour, colours.edge);
    if (high < HEIGHT_M) this.face(ctx, ring.map((at) => this.see(...at, high)), colour, colours.edge);
  }

  body(ctx, { x, y, heading, number }) {
    const [s, c] = [Math.sin(heading * RAD), Math.cos(heading * RAD)];
    const corner = (right, ahead) => [x + right * c + ahead * s, y - right * s + ahead * c];
    const colour = colours.tractor(number);
    this.block(ctx, [corner(-1, -2), corner(1, -2), corner(1, 1.6), corner(-1, 1.6)], 0.4, 1.5, colour);
    this.block(ctx, [corner(-0.8, -1.6), corner(0.8, -1.6), corner(0.8, -0.2), corner(-0.8, -0.2)], 1.5, BODY_M, colour);
    const at = this.see(x, y, BODY_M + 0.7);
    if (at[2] < NEAR_M) return;
    const [px, py] = this.pixel(at);
    ctx.font = "750 14px system-ui, sans-serif";
    ctx.textAlign = "center";
    ctx.strokeStyle = colours.halo;
    ctx.lineWidth = 3;
    ctx.strokeText(String(number), px, py);
    ctx.fillStyle = colour;
    ctx.fillText(String(number), px, py);
  }

  close() { this.forget(); }
}

// The outline of a line made wide: along its left, and back along its right.
function ribbon(points, width) {
  const sides = points.map(([x, y], k) => {
    const [a, b] = [points[Math.max(k - 1, 0)], points[Math.min(k + 1, points.length - 1)]];
    const length = Math.hypot(b[0] - a[0], b[1] - a[1]) || 1;
    const [sx, sy] = [(-(b[1] - a[1]) / length) * width / 2, ((b[0] - a[0]) / length) * width / 2];
    return [[x + sx, y + sy], [x - sx, y - sy]];
  });
  return [...sides.map(([left]) => left), ...sides.map(([, right]) => right).reverse()];
}

// How far a place is from a segment.
function away([ax, ay], [bx, by], x, y) {
  const [dx, dy] = [bx - ax, by - ay], square = dx * dx + dy * dy || 1e-9;
  const share = Math.max(0, Math.min(1, ((x - ax) * dx + (y - ay) * dy) / square));
  return Math.hypot(ax + share * dx - x, ay + share * dy - y);
}
