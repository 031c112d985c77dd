// The live state of a fleet: frames of its link, merged, and its tractors' places between two fixes.
import { Link } from "./link.js";
import { t, translate } from "./language.js";
import { Coverage } from "./coverage.js";
import { part, post, token } from "./api.js";
import { ServiceClock, Stamp } from "./control.js";

/** Data older than this is shown as old. */
export const FRESH_S = 1.0;
const STOPPED_MS = 300, LONGEST_AHEAD_S = 1.0, TRAIL = 1500, RAD = Math.PI / 180;

export class FleetLive {
  constructor(id, name = id) {
    Object.assign(this, { id, name, scene: null, fleet: {}, alarms: [], proposal: null, mayControl: false, link: "",
      events: [], said: "", settings: {}, fixes: new Map(), trails: new Map(), leases: new Map(), watchers: new Set() });
    this.coverage = new Coverage();
    this.clock = new ServiceClock();
    this.stamp = new Stamp(this.clock);
    this.connection = new Link(id, {
      role: token.get() ? "control" : "viewer",
      heard: (frame) => this.hear(frame),
      changed: (state) => { this.link = state; this.tell("link"); },
    });
  }

  hear(frame) {
    const how = this[`on_${frame.kind}`];
    if (how) how.call(this, frame);
    this.tell(frame.kind);
  }

  on_welcome(frame) {
    this.mayControl = frame.role === "control";
    this.leases.clear();
    this.settings = frame.settings ?? {};
    this.clock.begin();
    this.clock.heard(frame.server_time);
  }

  on_scene(scene) {
    const [east, north] = scene.origin_m ?? [0, 0];
    const local = (points) => (points ?? []).map(([e, n]) => [e - east, n - north]);
    const rings = (list) => (list ?? []).map((one) => local(one.polygon_m ?? one));
    this.origin = [east, north];
    this.scene = {
      crs: scene.crs ?? null, rings: rings(scene.field), fence: rings(scene.fence), width: scene.width_m ?? 3,
      obstacles: rings([...(scene.field_obstacles ?? []), ...(scene.obstacles ?? [])]), marked: scene.obstacles ?? [],
      machines: scene.tractors, lanes: scene.tractors.map((one) => one.legs.map((leg) => legOf(leg, local(leg.points_m)))),
    };
    this.scenes = (this.scenes ?? 0) + 1;
    this.coverage.room(boxOf(this.scene));
    for (let n = 1; n <= this.scene.lanes.length; n++) if (!this.fixes.has(n)) this.fixes.set(n, { tractor: n, connection: "offline" });
  }

  on_tick(frame) {
    const now = performance.now();
    this.heard = now;
    for (const one of frame.tractors ?? []) {
      const before = this.fixes.get(one.tractor);
      const fix = { ...before, ...one, heard: now };
      if (typeof one.easting_m === "number" && this.origin) {
        fix.x = one.easting_m - this.origin[0];
        fix.y = one.northing_m - this.origin[1];
        if (fix.x !== before?.x || fix.y !== before?.y) this.turned(fix, before, now);
        this.remember(fix);
      }
      this.fixes.set(one.tractor, fix);
    }
    if (frame.fleet) this.fleet = frame.fleet;
    if (typeof frame.time === "string") this.time = frame.time;
    this.clock.heard(frame.time);
  }

  // The rate of turn from two fixes, so that the drawn path between them bends too.
  turned(fix, before, now) {
    const gap = before?.movedAt ? (now - before.movedAt) / 1000 : 0;
    const turn = ((fix.heading_deg - (before?.heading_deg ?? fix.heading_deg) + 540) % 360) - 180;
    fix.turnRate = gap > 0.02 && gap < 1 ? 0.5 * (before.turnRate ?? 0) + 0.5 * (turn / gap) : 0;
    fix.movedAt = now;
  }

  remember(fix) {
    const trail = this.trails.get(fix.tractor) ?? this.trails.set(fix.tractor, []).get(fix.tractor);
    const last = trail[trail.length - 1];
    if (last && Math.hypot(last[0] - fix.x, last[1] - fix.y) < 0.25) return;
    trail.push([fix.x, fix.y]);
    if (trail.length > TRAIL) trail.shift();
  }

  on_coverage(frame) {
    if (!this.scene) return;
    const local = frame.points.map((p) => (p ? [p[0] - this.origin[0], p[1] - this.origin[1]] : null));
    this.coverage.paint(frame.tractor, local, this.scene.width, frame.first);
  }

  on_alarms(frame) { this.alarms = frame.items ?? []; }
  on_proposal(frame) { if (!this.proposal || frame.id >= this.proposal.id) this.proposal = frame; }
  on_lease(frame) { this.leases.set(frame.tractor, frame); }
  on_refused(frame) { this.said = frame.sentence; }
  on_event(frame) { if (frame.what === "stop_all") this.stops = (this.stops ?? 0) + 1; this.events = [frame, ...this.events].slice(0, 60); }

  /** Where a tractor is now: its last fix driven on for at most a second, in metres and degrees; null without one. */
  pose(number) {
    const fix = this.fixes.get(number);
    if (fix?.x === undefined) return null;
    const moving = fix.connection === "online" && this.link === "online";
    const ahead = moving ? Math.min((performance.now() - fix.heard) / 1000, LONGEST_AHEAD_S) : 0;
    const turn = Math.max(-40, Math.min(40, fix.turnRate ?? 0));
    const heading = fix.heading_deg + 0.5 * turn * ahead;
    const way = (fix.speed_mps ?? 0) * ahead * (this.leg(number)?.gear === -1 ? -1 : 1);
    return { x: fix.x + way * Math.sin(heading * RAD), y: fix.y + way * Math.cos(heading * RAD),
      heading: fix.heading_deg + turn * ahead, fix, here: moving };
  }

  twin(number) {
    const twin = this.fixes.get(number)?.twin;
    return twin && this.origin ? { x: twin.easting_m - this.origin[0], y: twin.northing_m - this.origin[1], heading: twin.heading_deg } : null;
  }

  /** The age of the fix now, seconds. */
  age(number) {
    const fix = this.fixes.get(number);
    if (fix?.age_s === undefined || fix.age_s === null) return null;
    return fix.age_s + (performance.now() - fix.heard) / 1000;
  }

  /** How long the service has said nothing of this fleet, seconds; null before its first word. */
  silence() { return this.heard === undefined ? null : (performance.now() - this.heard) / 1000; }

  /** Whether what is shown of a tractor, or of the whole fleet, is no longer what is so. */
  isOld(number = null) {
    if (this.link !== "online" || (this.silence() ?? 0) > FRESH_S) return true;
    return number !== null && (this.age(number) ?? 0) > FRESH_S;
  }

  leg(number) { return this.scene?.lanes[number - 1]?.[this.fixes.get(number)?.leg] ?? null; }
  /** Who drives a tractor by remote control, and whether that is this page. */
  lease(number) { return this.leases.get(number) ?? { holder: this.fixes.get(number)?.holder ?? null, is_yours: false }; }
  numbers() { return [...this.fixes.keys()].sort((a, b) => a - b); }
  watch(watcher) { this.watchers.add(watcher); return () => this.watchers.delete(watcher); }
  tell(kind) { for (const watcher of this.watchers) watcher(kind, this); }
  send(frame) {
    // An order to resume carries its time: the service refuses one that arrives late.
    const time = ["resume", "start", "acknowledge"].includes(frame.kind) && this.clock.time(performance.now());
    const sent = this.connection.send(time ? { ...frame, time } : frame);
    if (!sent) { this.said = "There is no link to the service; nothing was sent."; this.tell("refused"); }
    return sent;
  }
  /** Stop all tractors over the link, and over HTTP as well if the service does not confirm at once. */
  stopAll() {
    const heard = this.stops ?? 0;
    if (!this.connection.send({ kind: "stop_all" })) return this.stopBesides();
    setTimeout(() => { if ((this.stops ?? 0) === heard) this.stopBesides(); }, STOPPED_MS);
  }

  async stopBesides() {
    try { await post(`fleets/${part(this.id)}/stop`); } catch (error) {
      this.said = t`The order to stop did not reach ${this.name}: ${translate(error.message)}`;
      this.tell("refused");
    }
  }

  close() { this.connection.close(); this.watchers.clear(); }
}

// A leg with its bounding box, to skip legs that are out of sight.
function legOf({ kind, number, gear, implement }, points) {
  const [xs, ys] = [0, 1].map((k) => points.map((point) => point[k]));
  return { kind, number, gear, implement, points, box: [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)] };
}

/** Bounding box of a scene: west, south, east, north. */
export function boxOf(scene) {
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  const take = ([x, y]) => {
    box[0] = Math.min(box[0], x); box[1] = Math.min(box[1], y);
    box[2] = Math.max(box[2], x); box[3] = Math.max(box[3], y);
  };
  scene.rings.flat().forEach(take);
  scene.lanes.forEach((legs) => legs.forEach((leg) => leg.points.forEach(take)));
  return Number.isFinite(box[0]) ? box : [0, 0, 100, 60];
}
