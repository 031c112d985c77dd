// How far a tractor is from what it could hit: obstacles and other tractors, from the sides of both.
import { t, translate } from "./language.js";
import { number } from "./words.js";

const RAD = Math.PI / 180, LEAST_WIDTH_M = 2;

/** The nearest obstacle or tractor: {name, metres, side}; null where there is none or the tractor's place is unknown. */
export function nearestThing(live, tractor) {
  const pose = live.pose(tractor), scene = live.scene;
  if (!pose || !scene) return null;
  const half = Math.max(scene.width, LEAST_WIDTH_M) / 2, unnamed = scene.obstacles.length - scene.marked.length;
  const found = scene.obstacles.map((ring, k) => {
    const at = nearestOf(ring, pose.x, pose.y);
    return { name: (k >= unnamed && scene.marked[k - unnamed].name) || "obstacle", at, metres: Math.max(0, gapTo(at, pose) - half) };
  });
  for (const other of live.numbers()) {
    const there = other === tractor ? null : live.pose(other);
    if (there) found.push({ name: t`tractor ${other}`, at: [there.x, there.y], metres: Math.max(0, gapTo([there.x, there.y], pose) - 2 * half) });
  }
  const nearest = found.reduce((least, one) => (least && least.metres <= one.metres ? least : one), null);
  return nearest && { name: nearest.name, metres: nearest.metres, side: sideOf(nearest.at, pose) };
}

/** A distance in words: 4.2 m to the pond, ahead. */
export const nearWords = (nearest) =>
  nearest ? t`${number(nearest.metres, nearest.metres < 10 ? 1 : 0, "m")} to ${translate(nearest.name)}, ${translate(nearest.side)}` : translate("nothing known near by");

const gapTo = ([x, y], pose) => Math.hypot(x - pose.x, y - pose.y);

function sideOf([x, y], pose) {
  const turn = ((Math.atan2(x - pose.x, y - pose.y) / RAD - pose.heading + 540) % 360) - 180;
  return Math.abs(turn) <= 45 ? "ahead" : Math.abs(turn) >= 135 ? "behind" : turn > 0 ? "right" : "left";
}

// The place of a ring that is nearest to a point; the point itself where that lies inside.
function nearestOf(ring, x, y) {
  let best = ring[0], least = Infinity, inside = false;
  ring.forEach(([ax, ay], k) => {
    const [bx, by] = ring[(k + 1) % ring.length];
    if (ay > y !== by > y && x < ((bx - ax) * (y - ay)) / (by - ay) + ax) inside = !inside;
    const [dx, dy] = [bx - ax, by - ay], square = dx * dx + dy * dy || 1e-9;
    const share = Math.max(0, Math.min(1, ((x - ax) * dx + (y - ay) * dy) / square));
    const at = [ax + share * dx, ay + share * dy], gap = Math.hypot(at[0] - x, at[1] - y);
    if (gap < least) { least = gap; best = at; }
  });
  return inside ? [x, y] : best;
}
