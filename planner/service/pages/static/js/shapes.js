// What a field is drawn of: its shapes in metres, with undo, read from GeoJSON and written as GeoJSON with the roles of the reader.

const UNDONE = 200, DECIMALS = 9, METRE_DECIMALS = 3;

/** What can be drawn: its name, what it is made of, the fewest points, and the properties that tell the reader. */
export const KINDS = {
  boundary: { words: "Boundary", form: "area", fewest: 3, one: true, properties: {} },
  hole: { words: "Hole", form: "area", fewest: 3, properties: {} },
  pole: { words: "Obstacle: a point", form: "point", fewest: 1, properties: { role: "obstacle", kind: "obstacle", radius_m: 1 } },
  area: { words: "Obstacle: an area", form: "area", fewest: 3, properties: { role: "obstacle", kind: "obstacle" } },
  ditch: { words: "Obstacle: a line", form: "line", fewest: 2, properties: { role: "obstacle", kind: "obstacle", width_m: 1 } },
  entrance: { words: "Entrance", form: "point", fewest: 1, one: true, properties: { role: "entrance" } },
  refill: { words: "Refill place", form: "point", fewest: 1, one: true, properties: { role: "refill" } },
  fence: { words: "Fence along the edge", form: "line", fewest: 2, properties: { edge: "fence" } },
  open: { words: "Open edge", form: "line", fewest: 2, properties: { edge: "open" } },
  guidance: { words: "Guidance line", form: "line", fewest: 2, properties: { role: "guidance" } },
  zone: { words: "Ground zone", form: "area", fewest: 3, properties: { ground: "soil" } },
  headland: { words: "Edge of a headland", form: "line", fewest: 2, properties: { role: "headland" } },
};

/** The size that a shape has besides its points: a radius or a width. */
export const sizeOf = (kind) => ({ pole: "radius_m", ditch: "width_m" })[kind] ?? null;

export const area = (ring) =>
  Math.abs(ring.reduce((sum, [x, y], k) => { const [u, v] = ring[(k + 1) % ring.length]; return sum + x * v - u * y; }, 0)) / 2;

const isWhole = ({ kind, points }) => points.length >= KINDS[kind].fewest;

/** Shapes that are being drawn: `shapes` [{kind, points, properties}], `at` the chosen {shape, point} by number. */
export class Drawing {
  constructor(shapes = []) {
    this.past = [];
    this.shapes = shapes;
    this.at = { shape: -1, point: -1 };
  }

  /** Remember how it is, so that the next change can be undone. */
  mark() {
    this.past.push(JSON.stringify([this.shapes, this.at]));
    if (this.past.length > UNDONE) this.past.shift();
  }

  undo() {
    if (this.past.length) [this.shapes, this.at] = JSON.parse(this.past.pop());
  }

  get chosen() { return this.shapes[this.at.shape] ?? null; }

  /** Add a point to the chosen shape of a kind, after the chosen point; or begin a shape. */
  add(kind, point) {
    this.mark();
    const { form, one, properties } = KINDS[kind];
    let number = this.chosen?.kind === kind ? this.at.shape : one ? this.shapes.findIndex((shape) => shape.kind === kind) : -1;
    if (form === "point" && !one) number = -1;
    if (number < 0) number = this.shapes.push({ kind, points: [], properties: { ...properties } }) - 1;
    const { points } = this.shapes[number];
    if (form === "point") points.splice(0, 1, point);
    const after = this.at.shape === number && this.at.point >= 0 ? this.at.point + 1 : points.length;
    if (form !== "point") points.splice(after, 0, point);
    this.at = { shape: number, point: form === "point" ? 0 : after };
  }

  /** A new point in the middle of an edge, chosen. */
  insert(number, after, point) {
    this.mark();
    this.shapes[number].points.splice(after + 1, 0, point);
    this.at = { shape: number, point: after + 1 };
  }

  moveTo(point) { if (this.chosen?.points[this.at.point]) this.chosen.points[this.at.point] = point; }

  /** Remove the chosen point, and its shape with its last point. */
  removePoint() {
    const shape = this.chosen;
    if (!shape?.points[this.at.point]) return;
    this.mark();
    shape.points.splice(this.at.point, 1);
    this.at.point = Math.min(this.at.point, shape.points.length - 1);
    if (!shape.points.length) this.drop();
  }

  removeShape() {
    if (!this.chosen) return;
    this.mark();
    this.drop();
  }

  drop() {
    this.shapes.splice(this.at.shape, 1);
    this.at = { shape: -1, point: -1 };
  }

  /** Shapes with too few points, which are not saved. */
  get unfinished() { return this.shapes.filter((shape) => !isWhole(shape)); }

  /** Square metres of the field without its holes and obstacles of an area. */
  get area() {
    const of = (kinds) => this.shapes.filter((one) => kinds.includes(one.kind) && isWhole(one)).reduce((sum, one) => sum + area(one.points), 0);
    return of(["boundary"]) - of(["hole", "area"]);
  }
}

// Which kind a feature of the reader is.
function kindOf({ geometry: { type }, properties }) {
  const { role, edge, ground } = properties ?? {};
  if (role === "obstacle") return { Point: "pole", LineString: "ditch" }[type] ?? "area";
  if (role === "entrance" || role === "refill" || role === "guidance" || role === "headland") return role;
  if (edge && type === "LineString") return edge === "fence" ? "fence" : "open";
  if (type === "LineString") return "guidance";
  return ground ? "zone" : "boundary";
}

/** Shapes of a GeoJSON as the service writes it; `into([a, b])` turns its coordinates into metres. */
export function shapesOf(collection, into) {
  const open = (ring) => ring.slice(0, -1).map(into);
  return collection.features.flatMap((feature) => {
    const kind = kindOf(feature), { coordinates } = feature.geometry, properties = { ...feature.properties };
    if (KINDS[kind].form === "point") return [{ kind, points: [into(coordinates)], properties }];
    if (KINDS[kind].form === "line") return [{ kind, points: coordinates.map(into), properties }];
    const [outline, ...holes] = coordinates;
    const inner = kind === "boundary" ? "hole" : "area";
    return [{ kind, points: open(outline), properties }, ...holes.map((ring) => ({ kind: inner, points: open(ring), properties: inner === "hole" ? {} : { role: "obstacle", kind: "obstacle" } }))];
  });
}

const rounded = (decimals) => (point) => point.map((one) => Number(one.toFixed(decimals)));

/** GeoJSON of shapes: `out([x, y])` gives degrees; without it coordinates are metres. Unfinished shapes are left out. */
export function geojsonOf(shapes, name, { out = null, header = null } = {}) {
  const whole = shapes.filter(isWhole), write = rounded(out ? DECIMALS : METRE_DECIMALS), place = (point) => write(out ? out(point) : point);
  const ring = (points) => [...points, points[0]].map(place);
  const feature = (type, coordinates, properties) => ({ type: "Feature", properties, geometry: { type, coordinates } });
  const holes = whole.filter((one) => one.kind === "hole").map((one) => ring(one.points));
  const features = whole.filter((one) => one.kind !== "hole").map(({ kind, points, properties }) => {
    if (kind === "boundary") return feature("Polygon", [ring(points), ...holes], { ...properties, name });
    if (KINDS[kind].form === "area") return feature("Polygon", [ring(points)], properties);
    return KINDS[kind].form === "line" ? feature("LineString", points.map(place), properties) : feature("Point", place(points[0]), properties);
  });
  const first = features.findIndex((one) => one.geometry.type === "Polygon" && !one.properties.role && !one.properties.ground);
  if (first > 0) features.unshift(...features.splice(first, 1));
  return { type: "FeatureCollection", ...(header ? { headland: header } : {}), features };
}
