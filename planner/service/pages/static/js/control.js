// Hands on a tractor: keys, touch or a gamepad give a share of full steering and full speed, while a dead-man switch is
// held. Releasing it (key up, finger off, window left, gamepad unplugged) means stop.

const RAMP_PER_S = 1.6, DEAD_ZONE = 0.08, DRIFT = 1e-4, SHOULDERS = [4, 5];
const KEYS = {
  ArrowLeft: ["left"], ArrowRight: ["right"], ArrowUp: ["on"], ArrowDown: ["back"],
  KeyA: ["left"], KeyD: ["right"], KeyW: ["on"], KeyS: ["back"],
};

/** Reads all devices; `read(now)` answers {held, steering, speed, by}, shares from -1 to 1, right and on positive. */
export class Hands {
  constructor({ surface, pad, ready }) {
    Object.assign(this, { ready, pad, down: new Set(), touch: null, let: false, ramp: 0, before: performance.now() });
    this.listeners = [
      [surface, "keydown", (event) => this.key(event, true)],
      [window, "keyup", (event) => this.key(event, false)],
      [window, "blur", () => this.release()],
      [window, "pagehide", () => this.release()],
      [document, "visibilitychange", () => this.release()],
      [pad, "pointerdown", (event) => this.grab(event)],
      [pad, "pointermove", (event) => this.drag(event)],
      ...["pointerup", "pointercancel", "lostpointercapture"].map((name) => [pad, name, () => { this.touch = null; }]),
    ];
    this.listeners.forEach(([node, name, how]) => node.addEventListener(name, how));
  }

  key(event, pressed) {
    if (event.code !== "Space" && !KEYS[event.code]) return;
    if (pressed && (!this.ready() || event.ctrlKey || event.altKey || event.metaKey)) return;
    // On a button or a slider, keys keep their usual meaning unless somebody is already driving.
    if (pressed && !this.down.size && event.target.closest("button, input")) return;
    if (pressed) { this.down.add(event.code); event.preventDefault(); } else this.down.delete(event.code);
  }

  grab(event) {
    if (!this.ready()) return;
    this.pad.setPointerCapture(event.pointerId);
    this.touch = [0, 0];
    this.drag(event);
  }

  drag(event) {
    if (!this.touch) return;
    const box = this.pad.getBoundingClientRect(), clip = (value) => Math.max(-1, Math.min(1, value));
    this.touch = [clip((event.clientX - box.left - box.width / 2) / (0.38 * box.width)),
      clip(-(event.clientY - box.top - box.height / 2) / (0.38 * box.height))];
  }

  release() {
    this.down.clear();
    this.touch = null;
    this.let = true; // a gamepad has no event for it: it counts as not held until its button was seen up
  }

  held(way) { return [...this.down].some((code) => KEYS[code]?.[0] === way); }

  read(now = performance.now()) {
    const step = Math.min((now - this.before) / 1000, 0.2) * RAMP_PER_S;
    this.before = now;
    const pad = this.gamepad();
    if (this.touch) return { held: true, steering: this.touch[0], speed: this.touch[1], by: "touch" };
    if (pad?.held) return pad;
    const wanted = this.held("right") - this.held("left");
    this.ramp += Math.max(-step, Math.min(step, wanted - this.ramp));
    if (this.down.has("Space")) return { held: true, steering: this.ramp, speed: this.held("on") - this.held("back"), by: "keys" };
    this.ramp = 0;
    return { held: false, steering: 0, speed: 0, by: pad ? "gamepad" : "" };
  }

  gamepad() {
    const pad = [...(navigator.getGamepads?.() ?? [])].find((one) => one?.connected);
    if (!pad) return null;
    const axis = (value) => (Math.abs(value) < DEAD_ZONE ? 0 : value);
    const pressed = SHOULDERS.some((k) => pad.buttons[k]?.pressed);
    if (document.hidden) this.let = true;
    else if (!pressed) this.let = false;
    const held = pressed && !this.let;
    const triggers = (pad.buttons[7]?.value ?? 0) - (pad.buttons[6]?.value ?? 0);
    return { held, steering: held ? axis(pad.axes[0] ?? 0) : 0, speed: held ? triggers || -axis(pad.axes[1] ?? 0) : 0, by: "gamepad" };
  }

  close() { this.listeners.forEach(([node, name, how]) => node.removeEventListener(name, how)); }
}

/** The clock of the service, from the times in its frames; the fastest frames count, the others were delayed. */
export class ServiceClock {
  constructor() { this.begin(); }

  begin() { this.ahead = -Infinity; this.at = 0; }

  heard(time, now = performance.now()) {
    const ahead = Date.parse(time) - now;
    if (!Number.isFinite(ahead)) return;
    this.ahead = Math.max(ahead, this.ahead - DRIFT * (now - this.at));
    this.at = now;
  }

  time(now = performance.now()) { return Number.isFinite(this.ahead) ? new Date(now + this.ahead).toISOString() : null; }
}

/** Numbers and dates commands: `next` returns both, null while the service's clock is unknown. */
export class Stamp {
  constructor(clock) { Object.assign(this, { clock, sequence: 0 }); }

  next(now = performance.now()) {
    const time = this.clock.time(now);
    return time && { sequence: this.sequence++, time };
  }
}

/** The command for the given shares: degrees positive to the right, metres a second at most `limit_mps`, direction. */
export function commandOf({ held, steering, speed }, { limit_mps, steering_deg }) {
  const still = !held;
  return {
    steering_command_deg: still ? 0 : Number((steering * steering_deg).toFixed(2)),
    speed_command_mps: still ? 0 : Number((Math.abs(speed) * limit_mps).toFixed(3)),
    shuttle: still ? 0 : Math.sign(speed) || 0,
    start: held && speed !== 0 ? 1 : 0,
  };
}
