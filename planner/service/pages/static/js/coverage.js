// Worked ground painted on a canvas of its own, once; the map lays it over the field.
import { colours } from "./palette.js";

const LARGEST_PX = 2048, FINEST_PX = 8;

export class Coverage {
  constructor() {
    this.canvas = document.createElement("canvas");
    this.lines = [];
    this.open = new Map();
    this.counts = new Map();
    this.box = null;
  }

  /** Make room for a box (west, south, east, north); what is painted already is painted anew in it. */
  room(box) {
    const wanted = [box[0] - 5, box[1] - 5, box[2] + 5, box[3] + 5];
    if (this.box && wanted.every((value, k) => Math.abs(value - this.box[k]) < 0.5)) return;
    this.box = wanted;
    const [w, h] = [this.box[2] - this.box[0], this.box[3] - this.box[1]];
    this.scale = Math.min(FINEST_PX, LARGEST_PX / Math.max(w, h));
    this.canvas.width = Math.ceil(w * this.scale);
    this.canvas.height = Math.ceil(h * this.scale);
    this.again();
  }

  again() {
    if (!this.box) return;
    this.canvas.getContext("2d").clearRect(0, 0, this.canvas.width, this.canvas.height);
    this.lines.forEach((line) => this.stroke(line, 0));
  }

  /** Paint on along points (metres; null lifts the brush), `width` metres wide; they follow the first so many. */
  paint(tractor, points, width, first = this.counts.get(tractor) ?? 0) {
    // After a lost link the service sends everything again.
    if (first < (this.counts.get(tractor) ?? 0)) this.forget(tractor);
    this.counts.set(tractor, first + points.length);
    let line = this.open.get(tractor), from = line ? line.points.length : 0;
    const painted = () => line && this.stroke(line, from);
    for (const point of points) {
      if (!point) {
        painted();
        line = null;
        continue;
      }
      if (!line) {
        line = { tractor, width, points: [] };
        from = 0;
        this.lines.push(line);
      }
      line.points.push(point);
    }
    painted();
    if (line) this.open.set(tractor, line); else this.open.delete(tractor);
  }

  forget(tractor) {
    this.lines = this.lines.filter((line) => line.tractor !== tractor);
    this.open.delete(tractor);
    this.again();
  }

  // What came after the first `from` points of a line, with the bend before it, so that no wedge stays open there.
  stroke({ tractor, points, width }, from) {
    if (!this.box || points.length < 2) return;
    const ctx = this.canvas.getContext("2d");
    ctx.strokeStyle = colours.tractor(tractor);
    ctx.lineWidth = width * this.scale;
    ctx.lineJoin = "round";
    ctx.beginPath();
    points.slice(Math.max(0, from - 2)).forEach(([x, y], k) => {
      const at = [(x - this.box[0]) * this.scale, (this.box[3] - y) * this.scale];
      if (k) ctx.lineTo(...at); else ctx.moveTo(...at);
    });
    ctx.stroke();
  }

  draw(ctx, view) {
    if (!this.box) return;
    const [x, y] = view.at(this.box[0], this.box[3]);
    const alpha = ctx.globalAlpha;
    ctx.globalAlpha = 0.42 * alpha;
    ctx.drawImage(this.canvas, x, y, (this.canvas.width / this.scale) * view.scale, (this.canvas.height / this.scale) * view.scale);
    ctx.globalAlpha = alpha;
  }
}
