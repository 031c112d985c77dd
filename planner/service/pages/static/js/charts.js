// Strip charts on a canvas: a line per series against the last seconds, with zero and the largest values marked.
import { el } from "./dom.js";
import { t, translate } from "./language.js";
import { colours, onColours } from "./palette.js";

const LEFT = 46, RIGHT = 8, TOP = 32, BOTTOM = 22, GAP = 14;

/** A round value not below one: 1, 2, 5, 10, ... */
export function roundUp(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((k) => k * power).find((k) => k >= value * 0.999);
}

/** A value of two digits in as little room as a scale has: 0.05, 20, -50k. */
export function short(value) {
  const two = Number(value.toPrecision(2));
  return Math.abs(two) >= 10000 ? `${two / 1000}k` : String(two);
}

/** `series`: name, colour and unit each; `add(time, values)` in seconds, `last_s` seconds are shown. */
export class StripChart {
  constructor(title, { unit, series, last_s = 60, least = 0.1, both = false, decimals = 2 }) {
    this.node = el("canvas", { class: "chart", role: "img", "aria-label": title });
    Object.assign(this, { title, unit, series, last_s, least, both, decimals, rows: [] });
    this.resizing = new ResizeObserver(() => this.draw());
    this.resizing.observe(this.node);
    this.forget = onColours(() => this.draw());
  }

  add(time, values) {
    const last = this.rows[this.rows.length - 1];
    if (last && time < last[0]) this.rows = [];
    this.rows.push([time, ...values]);
    while (this.rows.length && this.rows[0][0] < time - this.last_s) this.rows.shift();
  }

  /** Replace all rows; rows too old to be shown are dropped. */
  set(rows) {
    const end = rows.length ? rows[rows.length - 1][0] : 0;
    this.rows = rows.filter((row) => row[0] >= end - this.last_s);
    this.draw();
  }

  draw() {
    const { clientWidth: width, clientHeight: height } = this.node;
    if (!width) return;
    const ratio = window.devicePixelRatio || 1, ctx = this.node.getContext("2d");
    this.node.width = Math.round(width * ratio);
    this.node.height = Math.round(height * ratio);
    ctx.scale(ratio, ratio);
    ctx.font = "12px system-ui, sans-serif";
    const values = this.rows.flatMap((row) => row.slice(1)).filter(Number.isFinite);
    const top = roundUp(Math.max(this.least, ...values.map(Math.abs))), low = this.both ? -top : 0;
    const end = this.rows.length ? this.rows[this.rows.length - 1][0] : this.last_s;
    const x = (time) => LEFT + (1 - (end - time) / this.last_s) * (width - LEFT - RIGHT);
    const y = (value) => TOP + ((top - value) / (top - low)) * (height - TOP - BOTTOM);
    this.frame(ctx, width, height, x, y, top, low, end);
    this.series.forEach((one, k) => this.lineOf(ctx, x, y, k + 1, one));
  }

  frame(ctx, width, height, x, y, top, low, end) {
    ctx.fillStyle = colours.soft;
    ctx.strokeStyle = colours.rule;
    ctx.lineWidth = 1;
    ctx.textAlign = "right";
    for (const value of this.both ? [top, 0, low] : [top, top / 2, 0]) {
      ctx.beginPath(); ctx.moveTo(LEFT, y(value)); ctx.lineTo(width - RIGHT, y(value)); ctx.stroke();
      ctx.fillText(short(value), LEFT - 6, y(value) + 4);
    }
    ctx.fillText(translate("now"), width - RIGHT, height - 5);
    ctx.textAlign = "left";
    ctx.fillText(t`${this.last_s} s ago`, LEFT, height - 5);
    ctx.font = "600 12px system-ui, sans-serif";
    ctx.fillStyle = colours.ink;
    const title = `${translate(this.title)}, ${this.unit}`;
    ctx.fillText(title, 2, 12);
    const left = 2 + ctx.measureText(title).width, all = this.series.map((one, k) => this.wordsOf(one, k));
    const room = width - RIGHT - left - all.reduce((sum, words) => sum + ctx.measureText(words).width + GAP, 0);
    let at = width - RIGHT;
    ctx.textAlign = "right";
    for (const [k, one] of [...this.series.entries()].reverse()) {
      ctx.fillStyle = colours[one.colour];
      ctx.fillText(all[k], at, room < 0 ? 26 : 12); // under the title where there is no room beside it
      at -= ctx.measureText(all[k]).width + GAP;
    }
    ctx.textAlign = "left";
  }

  wordsOf(one, k) {
    const value = this.rows.at(-1)?.[k + 1];
    return `${translate(one.name)} ${Number.isFinite(value) ? value.toFixed(this.decimals) : "\u2013"}`;
  }

  lineOf(ctx, x, y, column, one) {
    ctx.strokeStyle = colours[one.colour];
    ctx.lineWidth = 1.8;
    ctx.beginPath();
    let drawn = false;
    for (const row of this.rows) {
      if (!Number.isFinite(row[column])) { drawn = false; continue; }
      if (drawn) ctx.lineTo(x(row[0]), y(row[column])); else ctx.moveTo(x(row[0]), y(row[column]));
      drawn = true;
    }
    ctx.stroke();
  }

  close() { this.resizing.disconnect(); this.forget(); }
}
