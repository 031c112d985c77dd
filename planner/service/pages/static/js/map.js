// A map in metres on a canvas: north up, moved and zoomed by pointer, wheel, keys and buttons. Layers draw on it.
import { inUnits } from "./units.js";
import { el, say, button, icon } from "./dom.js";
import { t, translate } from "./language.js";
import { backgroundOf, drawTiles, isOn, onBackground, placementOf, switchOn, trouble } from "./background.js";
import { colours, onColours, paper } from "./palette.js";

const LOWEST_PX = 240, AROUND_PX = 110, NEAREST_PX = 60, FARTHEST_PX = 0.02, STEP = 1.3, PAN_PX = 60, CLICK_PX = 6;

/** `view.at(x, y)` are pixels of a place in metres, `view.place(px, py)` the other way, `view.scale` pixels a metre. */
export class MapView {
  constructor(label, { short = false, keys = "" } = {}) {
    this.canvas = el("canvas", { tabindex: "0", role: "application", "aria-label": t`${translate(label)}. Arrow keys move it, plus and minus zoom, 0 shows all. ${translate(keys)}`.trim() });
    this.tools = el("div", { class: "tools" },
      button("+", () => this.zoom(STEP), "", { "aria-label": "Zoom in" }),
      button("\u2212", () => this.zoom(1 / STEP), "", { "aria-label": "Zoom out" }),
      button(icon("M4 9V4h5M15 4h5v5M20 15v5h-5M9 20H4v-5"), () => this.fit(), "", { "aria-label": "Show all", title: "Show all" }));
    this.switch = button("Background", () => switchOn(!isOn()), "wide", { hidden: true });
    this.tools.prepend(this.switch);
    this.credit = el("p", { class: "credit", hidden: true });
    this.node = el("div", { class: `map${short ? " short" : ""}` }, this.canvas, this.credit, this.tools);
    Object.assign(this, { shaped: !short, layers: [], box: [0, 0, 100, 60], x: 50, y: 30, scale: 4, fitted: true, pointers: new Map(), clicked: null, dragged: null, grounds: [], about: null, closed: false });
    this.listen();
    this.resizing = new ResizeObserver(() => this.resize());
    this.resizing.observe(this.node);
    const unwatch = [onColours(() => this.redraw()), onBackground(() => { this.showSwitch(); this.redraw(); })];
    this.forget = () => unwatch.forEach((end) => end());
  }

  /** Where the metres of this map lie on the earth, for its background: [{crs, origin, box, shift}], one for each grid.

  `origin` is the easting and northing of 0, 0 of the grid, `shift` where the map draws that; of several grids each is
  drawn within its box alone. */
  async setGrounds(given) {
    const asked = (this.asked = {}), around = ({ box }) => [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2];
    this.grounds = [];
    this.about = given.some((one) => one.crs) ? await backgroundOf() : null;
    const found = this.about ? await Promise.all(given.map(async (one) => ({ ...one, box: given.length > 1 ? one.box : null, placement: await placementOf(one.crs, one.origin, around(one)) }))) : [];
    if (asked !== this.asked || this.closed) return;
    this.grounds = found.filter((one) => one.placement);
    this.showSwitch();
    this.redraw();
  }

  /** Whether a background is shown, so that what lies over it must be seen through. */
  get backed() { return this.grounds.length > 0 && isOn(); }

  showSwitch() {
    this.switch.hidden = !this.grounds.length;
    this.switch.setAttribute("aria-pressed", String(this.backed));
    this.credit.hidden = !this.backed;
    if (this.backed) say(this.credit, trouble() || this.about.attribution);
  }

  drawBackground(ctx) {
    for (const ground of this.grounds) drawTiles(ctx, this, this.about, ground);
    ctx.fillStyle = colours.ground;
    ctx.globalAlpha = 0.18; // a veil, so that lines and words stand out
    ctx.fillRect(0, 0, this.width, this.height);
    ctx.globalAlpha = 1;
  }

  listen() {
    const canvas = this.canvas;
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => this.up(event));
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY / 500), [event.offsetX, event.offsetY]);
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  key(event) {
    const ways = { ArrowLeft: [-PAN_PX, 0], ArrowRight: [PAN_PX, 0], ArrowUp: [0, -PAN_PX], ArrowDown: [0, PAN_PX] };
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (ways[event.key]) this.pan(...ways[event.key]);
    else if (event.key === "+" || event.key === "=") this.zoom(STEP);
    else if (event.key === "-") this.zoom(1 / STEP);
    else if (event.key === "0") this.fit();
    else return;
    event.preventDefault();
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    this.from = [event.offsetX, event.offsetY];
    this.moved = this.pointers.size > 1;
    this.grabbed = this.pointers.size === 1 && this.dragged?.("start", this.place(...this.from), event);
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.offsetX, event.offsetY];
    this.pointers.set(event.pointerId, now);
    if (Math.hypot(now[0] - this.from[0], now[1] - this.from[1]) > CLICK_PX) this.moved = true;
    if (this.grabbed) return this.dragged("move", this.place(...now), event);
    if (this.pointers.size === 1) return this.moved && this.pan(before[0] - now[0], before[1] - now[1]);
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)[1];
    const gap = (a) => Math.hypot(a[0] - other[0], a[1] - other[1]) || 1;
    this.zoom(gap(now) / gap(before), other);
  }

  up(event) {
    this.pointers.delete(event.pointerId);
    if (this.grabbed) this.dragged("end", this.place(event.offsetX, event.offsetY), event);
    else if (!this.moved && event.type === "pointerup") this.clicked?.(this.place(event.offsetX, event.offsetY), event);
    this.grabbed = false;
  }

  pan(dx, dy) {
    this.fitted = false;
    this.x += dx / this.scale;
    this.y -= dy / this.scale;
    this.redraw();
  }

  zoom(factor, at = [this.width / 2, this.height / 2]) {
    const [x, y] = this.place(...at);
    this.fitted = false;
    this.scale = Math.min(NEAREST_PX, Math.max(FARTHEST_PX, this.scale * factor));
    this.x = x - (at[0] - this.width / 2) / this.scale;
    this.y = y + (at[1] - this.height / 2) / this.scale;
    this.redraw();
  }

  /** Fit a box (west, south, east, north) into the view; without one, the last box. */
  fit(box = this.box) {
    this.box = box;
    this.fitted = true;
    if (!this.width) return;
    if (this.shaped) this.takeShape();
    const [w, h] = [Math.max(box[2] - box[0], 5), Math.max(box[3] - box[1], 5)];
    this.scale = Math.min((this.width - 40) / w, (this.height - 96) / h, NEAREST_PX);
    this.x = (box[0] + box[2]) / 2;
    this.y = (box[1] + box[3]) / 2 + 12 / this.scale;
    this.redraw();
  }

  // The height follows the shape of the content; the style sheet limits it.
  takeShape() {
    const [west, south, east, north] = this.box, share = (north - south) / Math.max(east - west, 1);
    this.node.style.setProperty("--height", `${Math.round(Math.max(LOWEST_PX, this.node.clientWidth * share + AROUND_PX))}px`);
    this.height = this.node.clientHeight;
  }

  /** Keep a place in the middle. */
  centre(x, y) {
    this.x = x;
    this.y = y;
    this.fitted = false;
    this.redraw();
  }

  resize() {
    const ratio = window.devicePixelRatio || 1;
    this.width = this.node.clientWidth;
    this.height = this.node.clientHeight;
    this.canvas.width = Math.round(this.width * ratio);
    this.canvas.height = Math.round(this.height * ratio);
    if (this.fitted) this.fit();
    this.draw();
  }

  at(x, y) { return [(x - this.x) * this.scale + this.width / 2, (this.y - y) * this.scale + this.height / 2]; }
  place(px, py) { return [(px - this.width / 2) / this.scale + this.x, this.y - (py - this.height / 2) / this.scale]; }

  redraw() {
    if (paper.printed) return this.draw();
    if (this.waiting) return;
    this.waiting = requestAnimationFrame(() => { this.waiting = 0; this.draw(); });
  }

  draw() {
    if (!this.width) return;
    const ratio = window.devicePixelRatio || 1, ctx = this.canvas.getContext("2d");
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    ctx.fillStyle = colours.ground;
    ctx.fillRect(0, 0, this.width, this.height);
    if (this.backed) this.drawBackground(ctx);
    for (const layer of this.layers) {
      ctx.save();
      layer(ctx, this);
      ctx.restore();
    }
    this.legend(ctx);
  }

  // A bar of round length at the bottom left, and which way is north.
  legend(ctx) {
    const [perMetre, small] = inUnits(1, "m"), [perKm, large] = inUnits(1, "km"), isLarge = 120 / this.scale >= 1000;
    const unit = isLarge ? perKm / 1000 : perMetre, most = (120 / this.scale) * unit, power = 10 ** Math.floor(Math.log10(most));
    const round = [5, 2, 1].map((k) => k * power).find((k) => k <= most), px = (round / unit) * this.scale, y = this.height - 14;
    const words = `${round} ${isLarge ? large : small}`;
    ctx.font = "600 12px system-ui, sans-serif";
    ctx.strokeStyle = colours.halo;
    ctx.lineWidth = 5;
    const bar = () => { ctx.beginPath(); ctx.moveTo(14, y); ctx.lineTo(14 + px, y); ctx.stroke(); };
    bar();
    ctx.lineWidth = 3;
    ctx.strokeText(words, 20 + px, y + 4);
    ctx.strokeStyle = ctx.fillStyle = colours.ink;
    bar();
    ctx.fillText(words, 20 + px, y + 4);
    const x = this.width - 24;
    ctx.strokeStyle = colours.halo;
    ctx.textAlign = "center";
    ctx.beginPath();
    ctx.moveTo(x, y - 22); ctx.lineTo(x + 6, y - 8); ctx.lineTo(x - 6, y - 8); ctx.closePath();
    ctx.stroke();
    ctx.fill();
    ctx.strokeText("N", x, y + 4);
    ctx.fillText("N", x, y + 4);
    ctx.textAlign = "start";
  }

  close() {
    this.closed = true;
    this.resizing.disconnect();
    this.forget();
    cancelAnimationFrame(this.waiting);
  }
}
