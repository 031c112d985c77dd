// A time slider: play, pause and speed of playback.
import { el, say, button, option } from "./dom.js";
import { t, translate } from "./language.js";
import { clock } from "./words.js";

const play = () => `\u25B6\u00A0${translate("Play")}`;

export class Player {
  constructor({ end, moved, rates = [1, 10, 60, 300], rate = 60, begin = 0 }) {
    Object.assign(this, { end, moved, begin, now: 0, running: false });
    this.slider = el("input", { type: "range", min: "0", step: "any", max: String(end), value: "0", "aria-label": "Time since the start" });
    this.elapsed = el("output");
    this.action = button(play(), () => this.toggle(), "main");
    this.rate = el("select", { "aria-label": "Playback speed" }, rates.map((one) => option(String(one), t`${one} times`, one === rate)));
    this.slider.addEventListener("input", () => this.seek(Number(this.slider.value)));
    this.node = el("div", { class: "player" }, this.action, this.slider, this.elapsed, this.rate);
    this.seek(0);
  }

  toggle() {
    if (!this.running && this.now >= this.end) this.seek(0);
    this.running = !this.running;
    say(this.action, this.running ? "Pause" : play());
    if (this.running) this.frame = requestAnimationFrame((stamp) => { this.before = stamp; this.step(stamp); });
  }

  step(stamp) {
    if (!this.running) return;
    this.seek(Math.min(this.now + ((stamp - this.before) / 1000) * Number(this.rate.value), this.end));
    this.before = stamp;
    if (this.now >= this.end) return this.toggle();
    this.frame = requestAnimationFrame((next) => this.step(next));
  }

  seek(seconds) {
    this.now = seconds;
    this.slider.value = String(seconds);
    this.slider.setAttribute("aria-valuetext", clock(seconds));
    say(this.elapsed, clock(seconds));
    this.moved(seconds);
  }

  close() {
    this.running = false;
    cancelAnimationFrame(this.frame);
  }
}

/** The last index whose time is not after `at`. */
export function before(times, at) {
  let low = 0, high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= at) low = middle; else high = middle - 1;
  }
  return low;
}

/** Place and heading (degrees) of a lane at a time: knots `time_s` and `points_m`, status 4 is backwards. */
export function poseAt(lane, at) {
  const { time_s: time, points_m: points, status } = lane, i = before(time, at), j = Math.min(i + 1, points.length - 1);
  const share = time[j] > time[i] ? Math.min(1, Math.max(0, (at - time[i]) / (time[j] - time[i]))) : 0;
  const [x, y] = [0, 1].map((k) => points[i][k] + (points[j][k] - points[i][k]) * share);
  return { x, y, heading: headingAt(points, status, i), status: status[Math.min(i, status.length - 1)], knot: i };
}

// While standing it keeps the heading of its last move.
function headingAt(points, status, knot) {
  const of = (k) => {
    const [dx, dy] = [points[k + 1][0] - points[k][0], points[k + 1][1] - points[k][1]];
    return Math.hypot(dx, dy) < 0.02 ? null : Math.atan2(dx, dy) * (180 / Math.PI) + (status[k] === 4 ? 180 : 0);
  };
  for (let k = Math.min(knot, points.length - 2); k >= 0; k--) { const found = of(k); if (found !== null) return found; }
  for (let k = knot; k < points.length - 1; k++) { const found = of(k); if (found !== null) return found; }
  return 0;
}
