// Worked ground painted on a canvas of its own, once; the map lays it over the field.
import { colours } from "./palette.js";

const LARGEST_PX = 2048, FINEST_PX = 8;

export class Coverage {
  constructor() {
    this.canvas = document.createElement("canvas");
    this.strokes = [];
    this.ends = new Map();
    this.counts = new Map();
    this.box = null;
  }

  /** Make room for a box (west, south, east, north); what is painted already is painted anew in it. */
  room(box) {
    if (this.box && box.every((value, k) => Math.abs(value - this.box[k]) < 0.5)) return;
    this.box = [box[0] - 5, box[1] - 5, box[2] + 5, box[3] + 5];
    const [w, h] = [this.box[2] - this.box[0], this.box[3] - this.box[1]];
    this.scale = Math.min(FINEST_PX, LARGEST_PX / Math.max(w, h));
    this.canvas.width = Math.ceil(w * this.scale);
    this.canvas.height = Math.ceil(h * this.scale);
    this.again();
  }

  again() {
    if (!this.box) return;
    this.canvas.getContext("2d").clearRect(0, 0, this.canvas.width, this.canvas.height);
    this.strokes.forEach((stroke) => this.stroke(stroke));
  }

  /** Paint on along points (metres; null lifts the brush), `width` metres wide; they follow the first so many. */
  paint(tractor, points, width, first = this.counts.get(tractor) ?? 0) {
    // After a link was lost all is told from the beginning once more.
    if (first < (this.counts.get(tractor) ?? 0)) this.forget(tractor);
    this.counts.set(tractor, first + points.length);
    let line = this.ends.has(tractor) ? [this.ends.get(tractor)] : [];
    const flush = () => {
      if (line.length > 1) {
        const stroke = { tractor, line, width };
        this.strokes.push(stroke);
        this.stroke(stroke);
      }
    };
    for (const point of points) {
      if (point) { line.push(point); continue; }
      flush();
      line = [];
    }
    flush();
    if (line.length) this.ends.set(tractor, line[line.length - 1]);
    else this.ends.delete(tractor);
  }

  forget(tractor) {
    this.strokes = this.strokes.filter((stroke) => stroke.tractor !== tractor);
    this.ends.delete(tractor);
    this.again();
  }

  stroke({ tractor, line, width }) {
    if (!this.box) return;
    const ctx = this.canvas.getContext("2d");
    ctx.strokeStyle = colours.tractor(tractor);
    ctx.lineWidth = width * this.scale;
    ctx.lineJoin = "round";
    ctx.beginPath();
    line.forEach(([x, y], k) => {
      const at = [(x - this.box[0]) * this.scale, (this.box[3] - y) * this.scale];
      if (k) ctx.lineTo(...at); else ctx.moveTo(...at);
    });
    ctx.stroke();
  }

  draw(ctx, view, shift = [0, 0]) {
    if (!this.box) return;
    const [x, y] = view.at(this.box[0] + shift[0], this.box[3] + shift[1]);
    const alpha = ctx.globalAlpha;
    ctx.globalAlpha = 0.42 * alpha;
    ctx.drawImage(this.canvas, x, y, (this.canvas.width / this.scale) * view.scale, (this.canvas.height / this.scale) * view.scale);
    ctx.globalAlpha = alpha;
  }
}
