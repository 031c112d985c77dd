// The background of a map: tiles that the service fetches, laid into the metres of fields. Off until it is switched on.
import { get, part, picture } from "./api.js";

const KEY = "headland-background", MOST_TILES = 60, MOST_KEPT = 500, AT_ONCE = 6, AGAIN_MS = 20000, HALF_M = Math.PI * 6378137, KM = 1000;
const OVERLAP = 0.004;

const kept = new Map(), wanted = new Map(), watchers = new Set();
let about = null, running = 0;

/** What the service has as background; null where it has none. */
export const backgroundOf = () => (about ??= get("background").then((one) => (one.kind === "none" ? null : one)).catch(() => { about = null; return null; }));

export const isOn = () => localStorage.getItem(KEY) === "on";
const tell = () => watchers.forEach((watcher) => watcher());

/** Switch the background on or off on every map; remembered by this browser. */
export function switchOn(on) {
  localStorage.setItem(KEY, on ? "on" : "off");
  tell();
}

/** Call a function when the background is switched, and when a tile has come; returns one that unsubscribes. */
export function onBackground(watcher) {
  watchers.add(watcher);
  return () => watchers.delete(watcher);
}

/** Terms u^i v^j up to the third power, with u and v in kilometres, times coefficients. */
function polynomial([cx, cy], x, y) {
  const u = x / KM, v = y / KM, terms = [1, u, v, u * u, u * v, v * v, u ** 3, u * u * v, u * v * v, v ** 3];
  const sum = (c) => terms.reduce((total, term, k) => total + term * c[k], 0);
  return [sum(cx), sum(cy)];
}

/** Metres of a field on the earth: between them, web mercator and degrees. Made from an answer of background/placement. */
export class Placement {
  constructor(answer, origin = answer.origin_m) {
    this.answer = answer;
    this.shift = [origin[0] - answer.origin_m[0], origin[1] - answer.origin_m[1]];
  }

  toMercator(x, y) {
    const [mx, my] = polynomial(this.answer.to_mercator, x + this.shift[0], y + this.shift[1]);
    return [mx + this.answer.mercator_m[0], my + this.answer.mercator_m[1]];
  }

  fromMercator(mx, my) {
    const [x, y] = polynomial(this.answer.to_metres, mx - this.answer.mercator_m[0], my - this.answer.mercator_m[1]);
    return [x - this.shift[0], y - this.shift[1]];
  }

  /** Longitude and latitude of a place in metres. */
  toDegrees(x, y) {
    const [mx, my] = this.toMercator(x, y), lon = (mx / HALF_M) * 180;
    return [lon - 360 * Math.floor((lon + 180) / 360), Math.atan(Math.sinh((my / HALF_M) * Math.PI)) * (180 / Math.PI)];
  }

  fromDegrees(lon, lat) {
    const near = this.answer.mercator_m[0], mx = (lon / 180) * HALF_M;
    return this.fromMercator(mx + 2 * HALF_M * Math.round((near - mx) / (2 * HALF_M)), Math.asinh(Math.tan((lat * Math.PI) / 180)) * (HALF_M / Math.PI));
  }
}

const places = new Map();

/** The placement of metres with an origin in a system, about a point of them; null where they have no place. */
export async function placementOf(crs, origin, [x, y] = [0, 0]) {
  if (!crs) return null;
  const [easting, northing] = [Math.round(origin[0] + x), Math.round(origin[1] + y)], key = `${crs} ${easting} ${northing}`;
  if (!places.has(key)) places.set(key, get(`background/placement?crs=${part(crs)}&easting=${easting}&northing=${northing}`).catch(() => { places.delete(key); return null; }));
  const answer = await places.get(key);
  return answer && new Placement(answer, origin);
}

/** The placement of metres about a place in degrees, in its UTM zone. */
export const placementAt = async (lon, lat) => new Placement(await get(`background/placement?longitude=${lon}&latitude=${lat}`));

/** Draw the tiles of one ground: `ground` has a placement and, where several share a map, a box and a shift. */
export function drawTiles(ctx, view, info, ground) {
  const { placement, shift = [0, 0], box = null } = ground;
  const see = ([px, py]) => { const [x, y] = view.place(px, py); return [x - shift[0], y - shift[1]]; };
  const corners = [[0, 0], [view.width, 0], [0, view.height], [view.width, view.height]].map(see);
  const span = (k) => [Math.min(...corners.map((p) => p[k])), Math.max(...corners.map((p) => p[k]))];
  let [[west, east], [south, north]] = [span(0), span(1)];
  const reach = placement.answer.reach_m, [ox, oy] = placement.shift;
  [west, east, south, north] = [Math.max(west, -reach - ox), Math.min(east, reach - ox), Math.max(south, -reach - oy), Math.min(north, reach - oy)];
  if (box) [west, south, east, north] = [Math.max(west, box[0]), Math.max(south, box[1]), Math.min(east, box[2]), Math.min(north, box[3])];
  if (west >= east || south >= north) return;
  const ring = [[west, south], [east, south], [east, north], [west, north]].map((p) => placement.toMercator(...p));
  const [a, b] = [0, 1].map((k) => [Math.min(...ring.map((p) => p[k])), Math.max(...ring.map((p) => p[k]))]);
  const middle = [(west + east) / 2, (south + north) / 2], one = placement.toMercator(...middle), other = placement.toMercator(middle[0] + 100, middle[1]);
  const per = Math.hypot(other[0] - one[0], other[1] - one[1]) / 100, fine = (view.scale * Math.min(window.devicePixelRatio || 1, 2)) / per;
  let zoom = Math.min(info.most_zoom, Math.max(info.least_zoom, Math.ceil(Math.log2((fine * 2 * HALF_M) / info.tile_px) - 0.35))), range;
  do {
    const side = (2 * HALF_M) / 2 ** zoom, most = 2 ** zoom - 1, at = (value) => Math.min(most, Math.max(0, Math.floor(value)));
    range = [at((a[0] + HALF_M) / side), at((a[1] + HALF_M) / side), at((HALF_M - b[1]) / side), at((HALF_M - b[0]) / side)];
  } while ((range[1] - range[0] + 1) * (range[3] - range[2] + 1) > MOST_TILES && zoom-- > info.least_zoom);
  if ((range[1] - range[0] + 1) * (range[3] - range[2] + 1) > MOST_TILES) return;
  ctx.save();
  if (box) {
    const [[left, top], [right, low]] = [view.at(box[0] + shift[0], box[3] + shift[1]), view.at(box[2] + shift[0], box[1] + shift[1])];
    ctx.beginPath(); ctx.rect(left, top, right - left, low - top); ctx.clip();
  }
  for (let row = range[2]; row <= range[3]; row++) for (let column = range[0]; column <= range[1]; column++) drawTile(ctx, view, info, placement, shift, [zoom, column, row]);
  ctx.restore();
}

// A tile, or its part of a coarser one while it is not there.
function drawTile(ctx, view, info, placement, shift, [zoom, column, row]) {
  const image = imageOf(zoom, column, row), side = (2 * HALF_M) / 2 ** zoom, west = column * side - HALF_M, north = HALF_M - row * side;
  let found = image, cut = [0, 0, 1];
  for (let up = 1; !found && zoom - up >= info.least_zoom && up < 8; up++) {
    found = kept.get(`${zoom - up}/${column >> up}/${row >> up}`)?.image ?? (image === null ? imageOf(zoom - up, column >> up, row >> up) : null);
    const count = 2 ** up;
    cut = [(column % count) / count, (row % count) / count, 1 / count];
  }
  if (!found) return;
  const at = (mx, my) => { const [x, y] = placement.fromMercator(mx, my); return view.at(x + shift[0], y + shift[1]); };
  const [o, e, s] = [at(west, north), at(west + side, north), at(west, north - side)];
  ctx.save();
  // Three corners make an affine map; over one tile the fourth is off by far less than a pixel.
  ctx.transform(e[0] - o[0], e[1] - o[1], s[0] - o[0], s[1] - o[1], o[0], o[1]);
  const { width, height } = found;
  ctx.drawImage(found, cut[0] * width, cut[1] * height, cut[2] * width, cut[2] * height, 0, 0, 1 + OVERLAP, 1 + OVERLAP);
  ctx.restore();
}

// The picture of a tile if it is here; null where there is none; undefined while it is on its way.
function imageOf(zoom, column, row) {
  const key = `${zoom}/${column}/${row}`, known = kept.get(key);
  if (known && (known.image || performance.now() < known.until)) {
    kept.delete(key);
    kept.set(key, known);
    return known.image;
  }
  wanted.delete(key);
  wanted.set(key, performance.now());
  setTimeout(fetchNext);
  return undefined;
}

// The tiles asked for last come first; what no map has asked for lately is left out.
function fetchNext() {
  while (running < AT_ONCE && wanted.size) {
    const [key, asked] = [...wanted].pop();
    wanted.delete(key);
    if (performance.now() - asked > AGAIN_MS) continue;
    running += 1;
    const place = { image: undefined, until: Infinity };
    kept.set(key, place);
    picture(`background/tiles/${key}`).then((image) => { place.image = image; }, (error) => {
      Object.assign(place, { image: null, until: performance.now() + AGAIN_MS, trouble: error.message });
    }).finally(() => {
      running -= 1;
      for (const old of kept.keys()) { if (kept.size <= MOST_KEPT) break; if (kept.get(old).image !== undefined) kept.delete(old); else break; }
      tell();
      fetchNext();
    });
  }
}

/** Why tiles are missing, in the service's words; "" where nothing is wrong. */
export function trouble() {
  const now = performance.now();
  for (const one of [...kept.values()].reverse()) { if (one.image) return ""; if (one.trouble && now < one.until) return one.trouble; }
  return "";
}
